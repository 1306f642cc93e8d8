"""Quality of a filtered log: consistency, summary, observability, plots."""
