"""A Panda at rest, for commands with a made-up computation."""

import numpy as np

COUNT = 50
SETUP = """
[robot]
model = "panda"
[sensor]
noise_std = [0.1, 0.1, 0.1, 0.004, 0.004, 0.004]
[tool]
mass = 0.73
center_of_mass = [0.0, 0.0, 0.06]
inertia = [0.002, 0.0, 0.0, 0.002, 0.0, 0.001]
"""


def write_log(path, wrench):
    """A log of half a second with readings (COUNT, 6)."""
    np.savez(path, t=0.01 * np.arange(COUNT), q=np.zeros((COUNT, 7)), wrench=wrench)
