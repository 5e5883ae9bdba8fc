"""How robots of any make drive in the traffic of their building: what the base class of their devices is made of
(`devices/road_robot.py`)."""
