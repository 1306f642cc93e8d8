"""Terms: effects outside the catalogue, described by how a drive, such as motion or time, acts on the reading."""
