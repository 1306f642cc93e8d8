"""Generator of labelled logs. It shares no equation with the package: MuJoCo and SciPy compute the physics."""
