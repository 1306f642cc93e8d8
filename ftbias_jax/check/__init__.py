"""Plausibility check of a setup: wrong signs, units and frames are detected from logs before anything is filtered."""
