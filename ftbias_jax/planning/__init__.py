"""Planning of the next motion: the most informative one for requested parameters, and its expected accuracy."""
