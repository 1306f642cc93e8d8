"""Correction of a user's own simulator: sensor errors for any simulator, findings of a diagnosis in MJCF or URDF."""
