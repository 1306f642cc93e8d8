"""Faster implementations of the filters, each shown equal to the reference step by a test."""
