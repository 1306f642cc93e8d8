"""Pose, twist and acceleration of the sensor."""
