"""Logs as recordings of ROS 1 and ROS 2."""
