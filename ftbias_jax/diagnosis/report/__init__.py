"""A diagnosis for readers: JSON, tables, figures and the HTML page."""
