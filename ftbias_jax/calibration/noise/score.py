"""Log-likelihoods of the joints, and of the wrench given the joints, as functions of the logarithms of their noise."""

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
"""s at the start of every piece, and of every log, that the score leaves out because the prior dominates there."""
Free = tuple[tuple[str, tuple[int, ...]], ...]
"""Name of a noise parameter -> index of each of its numbers in a score's flattened argument; -1 = it stays zero."""


def rows_of(index: Mapping[str, np.ndarray]) -> Free:
    """Indices into the argument of a score that has one row per noise parameter."""
    ends = np.cumsum([len(lanes) for lanes in index.values()])
    return tuple(
        (name, tuple(range(end - len(index[name]), end))) for name, end in zip(index, map(int, ends), strict=True)
    )


def freed(params: Params, free: Free, logs: Array) -> Params:
    """Parameters with the noise whose logarithms are given; differentiable."""
    values = jnp.exp(jnp.append(jnp.ravel(logs), -jnp.inf))
    return with_noise(params, {name: values[jnp.array(lanes)] for name, lanes in free})


@dataclass(frozen=True)
class JointScore:
    """Log-likelihood of joint measurements, per joint; a newton.LaneScore whose parts are (params, pieces of logs)."""

    free: Free
    model: str
    burn_in: float = JOINT_BURN_IN
    """s at the start of every piece that the score leaves out."""

    def __call__(self, logs: Array, part: tuple[Params, Sample]) -> Array:
        """(K, n) logarithms -> (n,) nats."""
        params, pieces = part
        moved, length = freed(params, self.free, logs), measured_length(pieces)

        def one(samples: Sample) -> Array:
            inputs = stages.joint_inputs(moved.joint, pipeline.init(params, samples).joint, samples)
            return nats_in_pieces(JOINT_MODELS[self.model], inputs, counted(samples.dt, self.burn_in), length)

        return jax.vmap(one)(pieces).sum(0)


class WrenchLogs(NamedTuple):
    """Logs with smoothed joints, as the bias filter needs them; leading axis of L logs."""

    samples: Sample
    wrench_tool: Array
    """(L, T, 6) N, Nm: wrench of the tool at the smoothed joint states."""
    joint_variance: Array
    """(L, T, 6) N^2, Nm^2: the joints' share of the variance, plus that of the motion unless it is fitted."""
    velocity: Array | None = None
    """(L, T, n) rad/s, joint velocities; None = noise that grows with the motion is not fitted."""


@dataclass(frozen=True)
class WrenchScore:
    """Log-likelihood of the wrench given joints; a newton.LaneScore whose parts are (params, WrenchLogs)."""

    free: Free
    burn_in: float = WRENCH_BURN_IN
    """s at the start of every log that the score leaves out."""

    def __call__(self, logs: Array, part: tuple[Params, WrenchLogs]) -> Array:
        """(K, 6) logarithms -> (6,) nats, per axis; (P, 1) logarithms that affect all axes -> (1,) nats."""
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
    """(T, 6) or (1, 6) N^2, Nm^2: part of R that sensor and motion cause, at joint velocities (T, n) rad/s."""
    own: Array = total_variance(params)[None]
    shaking = None if velocity is None else bias_filter.vibration(params.bias, velocity)
    return own if shaking is None else own + bias_filter.white_share(params.bias, shaking)


@partial(jax.jit, static_argnames=("options", "moving"))
def smoothed_wrenches(params: Params, logs: Sample, options: Options, moving: bool = False) -> WrenchLogs:
    """Smooth the joints of logs with a leading axis; ``moving``: prepare a fit of noise that grows with the motion."""

    def one(samples: Sample) -> WrenchLogs:
        joints = smooth_joints(params, pipeline.init(params, samples), samples, options)
        wrench_tool, variance = stages.predict_wrenches(params, joints, samples, options)
        velocity = speeds_of(params.arm, joints.mean[:, :, 1]) if moving else None
        return WrenchLogs(samples, wrench_tool, variance - own_variance(params, velocity), velocity)

    return jax.vmap(one)(logs)
