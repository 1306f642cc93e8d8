"""Noise parameters and tool parameters estimated from logs."""
