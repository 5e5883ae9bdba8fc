"""A simulated robot with ROS 2: the nodes that a robot with Nav2 and a gripper has, on a body. It runs with the Python of a ROS.

Written from the documentation of the message types, and not from the adapter: it imports nothing of it.
"""
