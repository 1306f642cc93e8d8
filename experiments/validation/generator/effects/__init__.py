"""Effects that are applied to a log, by physics independent of the package's."""
