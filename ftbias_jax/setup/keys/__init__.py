"""The one table of a setup's keys: what the parser accepts, what editors complete, what the reference and the template
say."""
