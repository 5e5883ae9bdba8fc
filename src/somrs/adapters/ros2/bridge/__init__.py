"""The bridge to ROS 2: a program for the Python of the installed ROS (`__main__.py`). It is no part of the package `somrs` when it runs."""
