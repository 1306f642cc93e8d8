"""How good a filtered log is: consistency, summary, observability, plots."""
