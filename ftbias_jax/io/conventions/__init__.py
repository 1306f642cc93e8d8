"""Units and axes in which logs are recorded, turned into those of the package."""
