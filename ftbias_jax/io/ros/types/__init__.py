"""Messages of any type: their definitions, as a recording brings them, and fields by path."""
