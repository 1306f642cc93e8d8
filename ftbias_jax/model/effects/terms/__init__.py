"""Terms: effects outside the catalogue, described as what a drive of the motion or of time does to the reading."""
