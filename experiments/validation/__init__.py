"""Validation on withheld labels: logs simulated by independent physics are diagnosed without labels, then scored."""
