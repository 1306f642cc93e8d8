"""What single samples show before they are averaged into bins: spikes, lattices, saturation, jitter."""
