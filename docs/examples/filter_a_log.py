"""Filter a log: bias, drift and corrected wrench at every sample, with standard deviations."""

from pathlib import Path

import numpy as np

import ftbias_jax as ft

setup = ft.load_setup(Path(__file__).with_name("setup.toml"))
simulated = ft.simulate(setup, duration=20, rate=200, seed=1)
simulated.save("log.npz")

log = ft.read_log("log.npz", setup)  # your own recordings are read in the same way
result = ft.filter_log(setup, log, smooth=True)
print(result)
result.save("result.npz")

# The bias is the negative of the usual sensor offset: corrected wrench = reading + bias.
error = result.bias - simulated.truth.bias
inside = np.mean(np.abs(error) < 2 * result.bias_std)
print(f"the true bias is within two standard deviations at {inside:.0%} of the samples")
print("rms error of the smoothed bias [N, Nm]:", np.sqrt(np.mean((result.bias_smooth - simulated.truth.bias) ** 2, 0)))
