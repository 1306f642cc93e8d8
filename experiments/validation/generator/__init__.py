"""The maker of labelled logs. It shares no equation with the package: MuJoCo and SciPy do the physics here."""
