"""What held-out data say about a cause."""
