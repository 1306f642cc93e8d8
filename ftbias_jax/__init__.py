"""Bias and drift of a wrist force-torque sensor from a recorded log; see the README for the sign convention."""
