"""Recorded logs filtered: joints smoothed, the noise of the log found, then the bias sample by sample."""
