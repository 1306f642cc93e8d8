"""What a user calls: a log filtered or smoothed from a setup alone."""
