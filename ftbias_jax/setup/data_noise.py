"""The section [data_noise] of a setup: Sigma_D, the covariance of the data matrix D with W = D theta.

Where the acceleration, the rate and the direction of gravity at the sensor are known only so well, the wrench of the
tool is predicted only so well: R = Sigma_W + B Sigma_D B^T (report, section 3). Its 36 live variances follow from four
physical standard deviations (model/wrench/data_noise.py), or are stated one by one.
"""

from __future__ import annotations

import numpy as np

from ftbias_jax.setup.fields import NOT_NEGATIVE, Section, subsection, vector
from ftbias_jax.setup.types import DATA_NOISE_UNITS, DataNoiseSetup

ENTRIES = 36
"""Entries of D that are not always zero."""


def parse_data_noise(top: Section) -> DataNoiseSetup | None:
    """The section; None if it is absent or everything in it is zero."""
    section = subsection(top, "data_noise", (*DATA_NOISE_UNITS, "entries"))
    if "entries" in section.values:
        for key in DATA_NOISE_UNITS:
            if key in section.values:
                raise section.error(key, "excluded by data_noise.entries", "remove one of the two")
        entries = vector(section, "entries", ENTRIES, within=NOT_NEGATIVE)
        none = np.zeros(3)
        none.setflags(write=False)
        return DataNoiseSetup(none, none, none, none, entries) if entries.any() else None
    stds = [vector(section, key, 3, (0.0,) * 3, within=NOT_NEGATIVE, expand=True) for key in DATA_NOISE_UNITS]
    return DataNoiseSetup(*stds) if np.any(stds) else None
