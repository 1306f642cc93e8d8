"""Archives of logs: finding logs, recording the outcome of each, and monitoring a fleet of robots over time."""
