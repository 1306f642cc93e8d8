"""The commands that have to do with simulators and controllers of others."""
