"""Log-likelihoods of joints, and of the wrench given the joints, as functions of the logarithms of their noise."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.calibration.noise.values import total_variance, with_noise
from ftbias_jax.filtering import bias_filter, pipeline
from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.likelihood import counted, measured_length, nats_in_pieces
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.filtering.process_models import JOINT_MODELS, bias_model
from ftbias_jax.filtering.smoother import smooth_joints
from ftbias_jax.model.kinematics.recorded_pose import speeds_of
from ftbias_jax.model.params import Params
from ftbias_jax.types import Array, Sample

JOINT_BURN_IN, WRENCH_BURN_IN = 0.2, 1.0
"""s that do not count at the start of every piece, and of every log: the prior shows there."""
Free = tuple[tuple[str, tuple[int, ...]], ...]
"""Name of noise -> which entry of a score's argument, flattened, each of its numbers is; -1 = none, it stays zero."""


def rows_of(index: Mapping[str, np.ndarray]) -> Free:
    """The argument of a score whose every row is one kind of noise."""
    ends = np.cumsum([len(lanes) for lanes in index.values()])
    return tuple(
        (name, tuple(range(end - len(index[name]), end))) for name, end in zip(index, map(int, ends), strict=True)
    )


def freed(params: Params, free: Free, logs: Array) -> Params:
    """Parameters with the noise whose logarithms are given, to be differentiated."""
    values = jnp.exp(jnp.append(jnp.ravel(logs), -jnp.inf))
    return with_noise(params, {name: values[jnp.array(lanes)] for name, lanes in free})


@dataclass(frozen=True)
class JointScore:
    """Log-likelihood of joint measurements, by joint; a newton.LaneScore whose parts are (params, pieces of logs)."""

    free: Free
    model: str
    burn_in: float = JOINT_BURN_IN
    """s at the start of every piece that do not count."""

    def __call__(self, logs: Array, part: tuple[Params, Sample]) -> Array:
        """(K, n) logarithms -> (n,) nats."""
        params, pieces = part
        moved, length = freed(params, self.free, logs), measured_length(pieces)

        def one(samples: Sample) -> Array:
            inputs = stages.joint_inputs(moved.joint, pipeline.init(params, samples).joint, samples)
            return nats_in_pieces(JOINT_MODELS[self.model], inputs, counted(samples.dt, self.burn_in), length)

        return jax.vmap(one)(pieces).sum(0)


class WrenchLogs(NamedTuple):
    """What is left of logs for the bias filter, once their joints are smoothed; leading axis of logs."""

    samples: Sample
    wrench_tool: Array
    """(L, T, 6) of the smoothed joints."""
    joint_variance: Array
    """(L, T, 6) the joints' share of the variance, and that by motion, unless that is fitted."""
    velocity: Array | None = None
    """(L, T, n) rad/s; None = noise that grows with the motion is not fitted."""


@dataclass(frozen=True)
class WrenchScore:
    """Log-likelihood of the wrench given joints; a newton.LaneScore whose parts are (params, WrenchLogs)."""

    free: Free
    burn_in: float = WRENCH_BURN_IN
    """s at the start of every log that do not count."""

    def __call__(self, logs: Array, part: tuple[Params, WrenchLogs]) -> Array:
        """(K, 6) logarithms -> (6,) nats, by axis; (P, 1), which reach all axes -> (1,)."""
        params, whole = part
        params = freed(params, self.free, logs)
        length = measured_length(whole.samples)

        def one(log: WrenchLogs) -> Array:
            start = pipeline.init(params, log.samples)
            variance = log.joint_variance + own_variance(params, log.velocity)
            inputs = stages.bias_inputs(params, start, log.samples, log.wrench_tool, variance, log.velocity)
            weight = counted(log.samples.dt, self.burn_in)
            return nats_in_pieces(bias_model(inputs.density), inputs, weight, length)

        return jax.vmap(one)(whole).sum(0).reshape(logs.shape[1], -1).sum(1)


def own_variance(params: Params, velocity: Array | None) -> Array:
    """(T, 6) or (1, 6) N^2, Nm^2: what sensor and motion, at joint velocities (T, n), add to the joints' share of R."""
    own: Array = total_variance(params)[None]
    shaking = None if velocity is None else bias_filter.vibration(params.bias, velocity)
    return own if shaking is None else own + bias_filter.white_share(params.bias, shaking)


@partial(jax.jit, static_argnames=("options", "moving"))
def smoothed_wrenches(params: Params, logs: Sample, options: Options, moving: bool = False) -> WrenchLogs:
    """Logs with a leading axis, with their joints smoothed; ``moving``: for noise that grows with the motion, too."""

    def one(samples: Sample) -> WrenchLogs:
        joints = smooth_joints(params, pipeline.init(params, samples), samples, options)
        wrench_tool, variance = stages.predict_wrenches(params, joints, samples, options)
        velocity = speeds_of(params.arm, joints.mean[:, :, 1]) if moving else None
        return WrenchLogs(samples, wrench_tool, variance - own_variance(params, velocity), velocity)

    return jax.vmap(one)(logs)
