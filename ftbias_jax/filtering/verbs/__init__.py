"""Functions for users: filter or smooth a log, given a setup alone."""
