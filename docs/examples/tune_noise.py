"""Tune the noise to two logs by maximum likelihood, starting from a sensor noise that is three times too large."""

from dataclasses import replace
from pathlib import Path

import ftbias_jax as ft

truth = ft.load_setup(Path(__file__).with_name("setup.toml"))
logs = [ft.simulate(truth, duration=10, rate=200, seed=seed).log for seed in (1, 2)]

nominal = replace(truth, sensor=replace(truth.sensor, noise_std=3 * truth.sensor.noise_std))
tuned = ft.tune(nominal, logs, tie="pair", restarts=0)
print(tuned)
print("sensor noise [N, Nm]:", tuned.setup.sensor.noise_std, "truth:", truth.sensor.noise_std)
tuned.setup.save("tuned.toml")
