"""What programs run on: compiled loops, settings of JAX, processes and progress."""
