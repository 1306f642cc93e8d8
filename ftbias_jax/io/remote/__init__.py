"""Logs by URL."""
