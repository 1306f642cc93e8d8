"""Identification of a tool together with the place of the sensor, if held-out blocks are predicted better with it."""

import numpy as np

from ftbias_jax.calibration.identify import Identified, identify
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.model.params import Params
from ftbias_jax.types import Sample


def identify_with_place(
    params: Params, samples: Sample, options: Options, mounting: bool, gravity: bool, translation: bool
) -> Identified:
    """``identify``, without the place of the sensor if that is not needed; the errors are those with it in any case."""
    found = identify(params, samples, options, mounting, gravity, translation)
    if not translation or found.has_lever:
        return found
    without = identify(params, samples, options, mounting, gravity)
    stderr = np.where(np.isnan(without.stderr), np.nan, np.fmax(without.stderr, found.stderr))
    return without._replace(stderr=stderr, model_stderr=np.fmax(without.model_stderr, found.model_stderr))
