"""A first setup from what is known already: a built-in robot, a URDF, a recording."""
