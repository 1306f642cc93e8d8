"""A simulated log of a swinging arm of two joints, to which faults are added."""

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.model import simulate
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.model.simulate import Trajectory
from ftbias_jax.setup import parse_setup

SETUP = {
    "robot": {
        "joints": [
            {"axis": [0, 1, 0], "point": [0, 0, 0.3], "name": "pitch"},
            {"axis": [1, 0, 0], "point": [0, 0, 0.8], "name": "roll"},
        ],
        "flange": {"translation": [0, 0, 1]},
    },
    "sensor": {"noise_std": [0.1, 0.1, 0.1, 0.004, 0.004, 0.004]},
    "tool": {"mass": 0.7, "center_of_mass": [0.01, 0, 0.06]},
    "joints": {"process_noise_density": 1.0, "position_noise_std": 1e-4, "velocity_noise_std": 1e-3},
}


def simulated(setup, rate, seconds):
    """The log as arrays, and the true bias (T, 6)."""
    t = np.arange(rate * seconds) / rate
    speed = np.array([0.9, 1.3])
    phase = t[:, None] * speed + [0, 1]
    motion = (0.5 * np.sin(phase), 0.5 * speed * np.cos(phase), -0.5 * speed**2 * np.sin(phase))
    trajectory = Trajectory(*map(jnp.asarray, (t, *motion)))
    truth = simulate.simulate(jax.random.key(0), params_from_setup(parse_setup(setup)), trajectory)
    return {name: np.array(getattr(truth, name)) for name in ("t", "q", "dq", "wrench")}, np.array(truth.bias)
