"""The sections of a setup that speak of noise: [bias], [joints] and [data_noise].

[data_noise] states Sigma_D, the covariance of the data matrix D with W = D theta. Where the acceleration, the rate and
the direction of gravity at the sensor are known only so well, the wrench of the tool is predicted only so well:
R = Sigma_W + B Sigma_D B^T (report, section 3). Its 36 live variances follow from four physical standard deviations
(model/wrench/data_noise.py), or are stated one by one.
"""

from __future__ import annotations

import numpy as np

from ftbias_jax.setup.fields import Section
from ftbias_jax.setup.keys.read import open_section, read
from ftbias_jax.setup.keys.table import SECTIONS
from ftbias_jax.setup.recorded import PoseSetup
from ftbias_jax.setup.types import DATA_NOISE_UNITS, BiasSetup, DataNoiseSetup, JointSetup


def bias_section(top: Section) -> BiasSetup:
    """[bias]: the prior of the bias process."""
    section = open_section(top, "bias")
    return BiasSetup(**{key: read(section, key) for key in SECTIONS["bias"].keys})


def joints_section(top: Section, n: int, pose: PoseSetup | None) -> JointSetup:
    """[joints]: noise of the joint filter; n of them, or entries of a recorded pose."""
    section = open_section(top, "joints")
    position_std, velocity_std = (pose.position_noise_std, pose.velocity_noise_std) if pose else (None, None)
    return JointSetup(
        model=read(section, "model"),
        process_noise_density=read(section, "process_noise_density", n),
        position_noise_std=read(section, "position_noise_std", n, position_std),
        velocity_noise_std=read(section, "velocity_noise_std", n, velocity_std),
        initial_std=read(section, "initial_std"),
    )


def data_noise_section(top: Section) -> DataNoiseSetup | None:
    """[data_noise]; None if it is absent or everything in it is zero."""
    section = open_section(top, "data_noise")
    if "entries" in section.values:
        for key in DATA_NOISE_UNITS:
            if key in section.values:
                raise section.error(key, "excluded by data_noise.entries", "remove one of the two")
        entries = read(section, "entries")
        none = np.zeros(3)
        none.setflags(write=False)
        return DataNoiseSetup(none, none, none, none, entries) if entries.any() else None
    stds = [read(section, key) for key in DATA_NOISE_UNITS]
    return DataNoiseSetup(*stds) if np.any(stds) else None
