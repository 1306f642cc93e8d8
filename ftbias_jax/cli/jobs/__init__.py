"""Work on files: one log, an archive of logs, many diagnoses."""
