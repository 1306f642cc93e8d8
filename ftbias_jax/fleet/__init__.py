"""Many logs: which there are, what became of each, and what a fleet of robots shows over time."""
