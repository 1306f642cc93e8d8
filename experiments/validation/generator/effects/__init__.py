"""What is done to a log, by physics of its own."""
