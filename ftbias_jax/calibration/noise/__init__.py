"""Likelihoods of the noise of joints, bias, sensor and motion, its values by name, and the fit of Sigma_D."""
