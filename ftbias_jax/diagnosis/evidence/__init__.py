"""Evidence for causes from held-out data: gains, parameters with standard errors, the remaining gap and the verdict."""
