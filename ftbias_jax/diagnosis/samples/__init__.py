"""Effects found in single samples before they are averaged into bins: spikes, lattices, saturation, jitter."""
