"""The single table of a setup's keys, which parser, editors, reference and template share."""
