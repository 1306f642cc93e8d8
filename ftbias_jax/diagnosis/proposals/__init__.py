"""Starting values for effects whose fit has many local optima."""
