"""Least squares of effects on whitened innovations."""
