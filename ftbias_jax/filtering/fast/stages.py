"""The pipeline in three stages: all joints in one scan, kinematics of many samples together, six axes in one scan.

The fast route of ``pipeline.run``: equal to a scan of single steps to round-off. The axes of the bias filter are
independent: B Sigma_D B^T is diagonal when Sigma_D is, because the columns of B are multiples of unit vectors. The
kinematics have no memory, so effects that need the whole log act between the stages; without them a log passes in
chunks of time.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from ftbias_jax.filtering import bias_filter
from ftbias_jax.filtering.fast.scan import Inputs, Smoothed, States, Track, filter_scan
from ftbias_jax.filtering.process_models import JOINT_MODELS, Gated, ProcessModel, bias_model
from ftbias_jax.filtering.samples import pad
from ftbias_jax.filtering.step import Options, State, predict_wrench
from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.types import Model, Signals
from ftbias_jax.model.kinematics.recorded_pose import FreeBody, speeds_of
from ftbias_jax.model.params import JointNoise, Params
from ftbias_jax.model.wrench.batch import PIECE, wrenches
from ftbias_jax.model.wrench.tool_wrench import covariance_of_joints, joint_sensitivity, measurement_covariance
from ftbias_jax.runtime.compiled_loops import log_by_log_with_slopes, on_cpu
from ftbias_jax.types import Gaussian, Sample

PIECE_SAMPLES = 1024
"""Samples that pass through all stages together, so that what goes from one stage to the next stays in the cache."""


class Staged(NamedTuple):
    """The pipeline at every sample."""

    joint: Track
    """Track of the joints: states (T, 3, n)."""
    wrench: Track
    """Track of the axes of the bias: states (bias, drift) (T, 2, 6)."""
    wrench_tool: Float[Array, "T 6"]
    """(T, 6) D theta, N and Nm, sensor frame, including the known effects, if there are any."""


@partial(jax.jit, static_argnames="options")
def run(params: Params, state: State, samples: Sample, options: Options) -> tuple[State, Staged]:
    """Filter a whole log; arguments as for ``pipeline.run``.

    Returns:
        the last state and the track of every sample.
    """
    return log_by_log_with_slopes(partial(_run_log, options))(params, state, samples)


def _run_log(options: Options, params: Params, state: State, samples: Sample) -> tuple[State, Staged]:
    stages = partial(_run_stages, params, options)
    length = samples.dt.shape[0]
    if length <= PIECE_SAMPLES or params.effects is not None or not on_cpu():
        return stages(state, (samples, length))
    count = -(-length // PIECE_SAMPLES)
    size = PIECE * -(-length // (PIECE * count))
    padded = pad(samples, count * size)
    chunks = jax.tree.map(lambda x: x.reshape(count, size, *x.shape[1:]), padded)
    measured = jnp.minimum(length - size * jnp.arange(count), size)
    state, tracks = jax.lax.scan(stages, state, (chunks, measured))
    return state, jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:])[:length], tracks)


def _run_stages(
    params: Params, options: Options, state: State, chunk: tuple[Sample, int | Array]
) -> tuple[State, Staged]:
    """All stages over a chunk, of which the first ``measured`` samples belong to the log."""
    samples, measured = chunk
    joint = filter_scan(JOINT_MODELS[options.joint_model], joint_inputs(params.joint, state.joint, samples))
    wrench_tool, variance = predict_wrenches(params, joint, samples, options)
    inputs = bias_inputs(params, state, samples, wrench_tool, variance, speeds_of(params.arm, joint.mean[:, 1]))
    track = filter_scan(gated(inputs, options), inputs)
    mean, covariance = add_noise(track.mean, track.covariance, -1)
    wrench = track._replace(mean=mean, covariance=covariance)
    last = jax.tree.map(lambda x: x[measured - 1], (joint, wrench))
    return state_of(*last), Staged(joint, wrench, wrench_tool)


def joint_inputs(noise: JointNoise, start: Gaussian, samples: Sample) -> Inputs:
    """Inputs of the joint filters as a recursion: n filters of three states and two measurements."""
    y = jnp.stack([samples.q, samples.dq], 1)
    variance = jnp.stack([noise.position_std, noise.velocity_std]) ** 2
    restart = jnp.broadcast_to((noise.prior_std**2)[:, None], (3, y.shape[2]))
    mean, covariance = start.mean.T, jnp.moveaxis(start.covariance, 0, -1)
    return Inputs(samples.dt, noise.process_density, y, jnp.broadcast_to(variance, y.shape), mean, covariance, restart)


def gated(inputs: Inputs, options: Options) -> ProcessModel:
    """Process model of the bias for these inputs, with the gate if there is one."""
    model = bias_model(inputs.density)
    return model if options.gate is None else Gated(model, options.gate)


def bias_inputs(
    params: Params,
    state: State,
    samples: Sample,
    wrench_tool: Float[Array, "T 6"],
    variance: Float[Array, "T 6"],
    velocity: Float[Array, "T n"] | None = None,
) -> Inputs:
    """Inputs of the bias filter as a recursion: six filters of two states and one measurement, y = D theta - W.

    With correlated noise there are three states, (bias + noise, drift, noise), see ``process_models.correlated_bias``.
    The variance is the diagonal of R; the joint velocity, rad/s, is needed where vibration is correlated.
    """
    density, drive = bias_filter.driving(params, samples.rezeroed, velocity)
    y = (wrench_tool - samples.wrench)[:, None]
    axis, k = jnp.arange(6), state.bias.mean.shape[0] // 6
    blocks = state.bias.covariance.reshape(k, 6, k, 6)[:, axis, :, axis]  # (6, k, k): axes are independent
    never = jnp.full((k, 6), jnp.inf, y.dtype)
    mean, covariance = add_noise(state.bias.mean.reshape(k, 6), jnp.moveaxis(blocks, 0, -1), 1)
    return Inputs(samples.dt, density, y, variance[:, None], mean, covariance, never, drive)


def add_noise(mean: Array, covariance: Array, sign: float) -> tuple[Array, Array]:
    """States of the bias with the correlated noise added to the bias (sign 1) or subtracted again (sign -1).

    The mean is (..., k, 6); with k = 2 there is no such noise.
    """
    if mean.shape[-2] == 2:
        return mean, covariance
    T = jnp.eye(3, dtype=mean.dtype).at[0, 2].set(sign)
    return jnp.einsum("ab,...bx->...ax", T, mean), jnp.einsum("ab,...bcx,dc->...adx", T, covariance, T)


def joint_states(track: Track | Smoothed) -> Gaussian:
    """States of the joints with axes in the pipeline's order: mean (..., n, 3), covariance (..., n, 3, 3)."""
    return Gaussian(jnp.swapaxes(track.mean, -2, -1), jnp.moveaxis(track.covariance, -1, -3))


def predict_wrenches(
    params: Params, joints: Gaussian | Track | Smoothed | States, samples: Sample, options: Options
) -> tuple[Float[Array, "T 6"], Float[Array, "T 6"]]:
    """Expected reading without bias and noise (T, 6), D theta if there are no effects, and the diagonal of R (T, 6).

    Joint states have a leading axis T, with axes in the pipeline's order, as in a track, or with entries apart.
    """
    if isinstance(joints, Gaussian):
        joints = Smoothed(jnp.swapaxes(joints.mean, 1, 2), jnp.moveaxis(joints.covariance, 1, -1))
    R = measurement_covariance(params.theta, params.bias.data_variance, params.bias.wrench_variance)
    stated = jnp.diagonal(R)
    wrench_tool, from_joints = _wrenches_of_joints(params, joints, not options.uncertain_joints)
    if isinstance(joints, States):
        joints = joints.stacked()
    motion = bias_filter.vibration(params.bias, speeds_of(params.arm, joints.mean[:, 1]))
    if motion is not None:
        from_joints = from_joints + bias_filter.white_share(params.bias, motion)
    if params.effects is None and compose.EXTRA_WRENCH[0] not in (samples.columns or {}):
        return wrench_tool, from_joints + stated[None]
    signals = signals_of(params, jnp.swapaxes(joints.mean, 1, 2), samples)
    effects = params.effects or {}
    reading = compose.predict(signals, effects)
    dt = samples.dt[1:, None]
    rate = jnp.diff(reading, axis=0) / jnp.where(dt > 0, dt, jnp.inf)
    rate = jnp.concatenate([rate[:1], rate])
    of_terms = compose.variance_of_terms(signals, effects, reading)
    return reading, from_joints + of_terms + compose.noise_variance(stated, rate, signals.model, effects)


def _wrenches_of_joints(params: Params, joints: Track | Smoothed | States, known_exactly: bool) -> tuple[Array, Array]:
    """D theta (T, 6) N, Nm, sensor frame, and the variance (T, 6) that the joints' uncertainty adds to it."""
    if isinstance(params.arm, FreeBody):
        states = joint_states(joints.stacked() if isinstance(joints, States) else joints)
        return jax.vmap(partial(_of_free_body, params, known_exactly))(*states)
    # The wrench depends on q, dq and ddq, and its variance on P_qq, P_qa and P_aa: (T, n) each.
    if isinstance(joints, States):
        entries = [*joints.mean, *(joints.triangle[i] for i in (0, 2, 5))]
    else:
        mean, P = joints.mean, joints.covariance
        entries = [*(mean[:, a] for a in range(3)), P[:, 0, 0], P[:, 0, 2], P[:, 2, 2]]
    return wrenches(Model(params.arm, params.gravity, params.theta), *entries[: 3 if known_exactly else 6])


def _of_free_body(params: Params, known_exactly: bool, mean: Array, covariance: Array) -> tuple[Array, Array]:
    """Wrench of the tool (6,) and the variance that the pose adds (6,), for one sample of a recorded pose."""
    motion, wrench_tool = predict_wrench(params, mean)
    if known_exactly:
        return wrench_tool, jnp.zeros_like(wrench_tool)
    G = joint_sensitivity(params.theta, motion.R_base_sensor, motion.jacobian, params.gravity)
    return wrench_tool, jnp.diagonal(covariance_of_joints(G, covariance))


def predict_readings(params: Params, joints: Float[Array, "T n 3"], samples: Sample) -> Float[Array, "T 6"]:
    """Expected reading alone, (T, 6), for joint states (T, n, 3)."""
    return compose.predict(signals_of(params, joints, samples), params.effects or {})


def signals_of(params: Params, joints: Float[Array, "T n 3"], samples: Sample) -> Signals:
    """Signals of a log that the effects of the catalogue take as input; joints (T, n, 3)."""
    t = jnp.cumsum(samples.dt)
    temperature = jnp.zeros_like(t) if samples.temperature is None else samples.temperature
    (q, dq, ddq), model = jnp.moveaxis(joints, 2, 0), Model(params.arm, params.gravity, params.theta)
    return Signals(t, q, dq, ddq, temperature, model, None, samples.columns or {})


def state_of(joint: Track, wrench: Track) -> State:
    """The pipeline's state from tracks, with their leading time axis or for one sample without it."""
    return State(joint_states(joint), bias_state(wrench))


def bias_state(wrench: Track | Smoothed) -> Gaussian:
    """State of the bias filter from its track, axes as for ``state_of``."""
    mean, blocks = wrench.mean, diagonal_matrix(wrench.covariance)  # (..., k, k, 6, 6)
    time, size = mean.shape[:-2], 6 * mean.shape[-2]
    covariance = jnp.swapaxes(blocks, -3, -2).reshape(*time, size, size)
    return Gaussian(mean.reshape(*time, size), covariance)


def diagonal_matrix(x: Float[Array, "... k"]) -> Float[Array, "... k k"]:
    """(..., k) -> (..., k, k)."""
    one = jnp.eye(x.shape[-1], dtype=bool).reshape(*(1 for _ in x.shape[:-1]), x.shape[-1], x.shape[-1])
    return jnp.where(one, x[..., None], 0)
