"""The withheld check: logs by foreign physics, diagnosed without their labels, then scored."""
