"""What the rate of a stream hides: readings that are held over several samples, and stamps that scatter."""
