"""ROS 2: topics and actions of robots, bound to attributes and services by a file."""
