"""Mending a user's own simulator: the sensor's errors for any, and what a diagnosis found in the file of one."""
