"""Made-up errors of predictions."""

import numpy as np

from ftbias_jax.calibration.judgement import HORIZONS, SEGMENTS
from ftbias_jax.commissioning.judged import Judged

T = 4_000
SEGMENT = np.repeat(np.arange(SEGMENTS), T // SEGMENTS)


def judged(scale=1.0, seed=0, used=1.0, inside=0.95):
    rng = np.random.default_rng(seed)
    errors = scale * rng.standard_normal((len(HORIZONS), T, 6))
    took = rng.random(T) < used
    within = np.where(took[:, None], rng.random(errors.shape) < inside, np.nan)
    constant = 5.0 * rng.standard_normal((2, T, 6))
    return Judged(
        np.where(took[None, :, None], errors, np.nan), within, took.astype(float), SEGMENT, constant, np.zeros(1)
    )
