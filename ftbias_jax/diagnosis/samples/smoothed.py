"""Joint states of a log, smoothed over all of its samples, and the wrench that the tool then causes."""

from collections.abc import Callable, Iterator
from functools import partial

import jax
import numpy as np

from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.params_for_log import padded_length
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.filtering.samples import arrays_from_log, pad
from ftbias_jax.filtering.smoother import smoothed_joints
from ftbias_jax.io.log import Log
from ftbias_jax.model.params import Params
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.types import Array, Gaussian, Sample


def padded_samples(log: Log) -> Sample:
    """All samples of a log as NumPy arrays, padded to one of a few lengths so that logs share compiled programs."""
    return pad(arrays_from_log(log), padded_length(len(log.t)))


def smoothed(params: Params, samples: Sample, options: Options) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joint states (T, n, 3), the tool's wrench (T, 6) N, Nm, and its variance including that of the sensor at rest."""
    joints = smoothed_joints(params.joint, *samples[:3], model=options.joint_model)
    wrench, variance = (np.asarray(x) for x in _predicted(_at_rest(params), joints, samples, options=options))
    return np.asarray(joints.mean), wrench, variance


def programs_of_smoother(params: Params, samples: Sample, options: Options) -> Iterator[Callable[[], object]]:
    """Functions that load or compile the programs of ``smoothed`` for samples of these shapes."""
    noise, measured, model = params.joint, samples[:3], options.joint_model
    yield partial(smoothed_joints.prepare, noise, *measured, model=model)
    joints = jax.eval_shape(partial(smoothed_joints, model=model), noise, *measured)
    yield partial(_predicted.prepare, _at_rest(params), joints, samples, options=options)


def _at_rest(params: Params) -> Params:
    return params._replace(bias=params.bias.at_rest())


@keep_program("options")
def _predicted(params: Params, joints: Gaussian, samples: Sample, *, options: Options) -> tuple[Array, Array]:
    return stages.predict_wrenches(params, joints, samples, options)
