"""Presentation of a diagnosis: JSON, tables, figures and the HTML page."""
