"""Runtime infrastructure: compiled loops, JAX configuration, processes, signals and progress display."""
