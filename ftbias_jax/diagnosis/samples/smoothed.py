"""The joints of a log, smoothed over all of its samples, and the wrench that the tool then causes."""

import jax
import numpy as np

from ftbias_jax.filtering import pipeline, smoother
from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.filtering.samples import pad, samples_from_log
from ftbias_jax.io.log import Log
from ftbias_jax.model.params import Params
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.types import Array, Sample

PADDED, MOST_PADDED = 8192, 4 * 8192
"""Samples: logs of up to so many are smoothed in multiples of the first number, longer ones of twice as many."""


def padded_samples(log: Log) -> Sample:
    """All samples of a log, of numpy arrays, filled up to one of few lengths so that logs share programs."""
    samples, length = jax.tree.map(np.asarray, samples_from_log(log)), len(log.t)
    piece = PADDED if length <= MOST_PADDED else 2 * PADDED
    return pad(samples, piece * -(-length // piece))


def smoothed(params: Params, samples: Sample, options: Options) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joint states (T, n, 3), the wrench (T, 6) N, Nm of the tool, and its variance with that of the sensor at rest."""
    joints, wrench, variance = (np.asarray(x) for x in _smooth(_at_rest(params), samples, options=options))
    return joints, wrench, variance


def prepare_smoother(params: Params, samples: Sample, options: Options) -> None:
    """Make the program ready that smooths such samples, of which the shapes are enough."""
    _smooth.prepare(_at_rest(params), samples, options=options)


def _at_rest(params: Params) -> Params:
    return params._replace(bias=params.bias.at_rest())


@keep_program("options")
def _smooth(params: Params, samples: Sample, *, options: Options) -> tuple[Array, Array, Array]:
    joints = smoother.smooth_joints(params, pipeline.init(params, samples), samples, options)
    return joints.mean, *stages.predict_wrenches(params, joints, samples, options)
