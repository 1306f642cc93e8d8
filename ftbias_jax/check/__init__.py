"""Whether a setup can be right: wrong signs, units and frames recognised in the log, before anything is filtered."""
