"""Logs recorded with ROS 1 and ROS 2."""
