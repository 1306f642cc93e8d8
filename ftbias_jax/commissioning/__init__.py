"""Calibration of a setup from logs: every step is kept only if it predicts held-out data better."""
