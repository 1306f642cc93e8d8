"""The method over a whole log: ``init``, ``step`` and ``run``.

``scan_steps`` is the definition. ``run`` takes the fast route of ``fast/stages.py`` wherever that is exact, and is
tested equal to the definition.
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Float

from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.fast.kalman_step import predict
from ftbias_jax.filtering.fast.scan import Track
from ftbias_jax.filtering.fast.stages import Staged, diagonal_matrix, state_of
from ftbias_jax.filtering.gaussian import Innovation
from ftbias_jax.filtering.process_models import JOINT_MODELS
from ftbias_jax.filtering.step import (
    DEFAULT_OPTIONS,
    Emit,
    Info,
    Options,
    State,
    init,
    options_from_setup,
    predict_wrench,
    step,
)
from ftbias_jax.model.params import Params
from ftbias_jax.types import Array, Sample

__all__ = [
    "DEFAULT_OPTIONS",
    "Emit",
    "Info",
    "Options",
    "State",
    "init",
    "keep_all",
    "keep_result",
    "options_from_setup",
    "predict_wrench",
    "run",
    "scan_steps",
    "step",
]


def keep_result(state: State, info: Info) -> dict[str, Array]:
    """Per-sample content of a result: (n, 3), (n,), (2, 6) for bias and drift, (6,) and (), in rad, N, Nm and per s."""
    std = partial(jnp.diagonal, axis1=-2, axis2=-1)
    return {
        "joint": state.joint.mean,
        "ddq_std": jnp.sqrt(std(state.joint.covariance)[:, 2]),
        "bias": state.bias.mean[:12].reshape(2, 6),
        "bias_std": jnp.sqrt(std(state.bias.covariance)[:12]).reshape(2, 6),
        "wrench_tool": info.wrench_tool,
        "innovation": info.wrench.value,
        "innovation_std": jnp.sqrt(std(info.wrench.covariance)),
        "nis": info.wrench.nis,
        "log_likelihood": info.log_likelihood,
    }


def keep_all(state: State, info: Info) -> tuple[State, Info]:
    """Everything of a sample, including covariance matrices: takes several times the memory and the time."""
    return state, info


@partial(jax.jit, static_argnames=("options", "emit"))
def run(
    params: Params, state: State, samples: Sample, options: Options = DEFAULT_OPTIONS, emit: Emit = keep_result
) -> tuple[State, Any]:
    """Filter a whole log: equal to ``scan_steps`` to round-off, and over ten times faster.

    The fast route has a hand-written reverse pass. It reports a gradient of zero with respect to ``samples.dt``, does
    not support forward mode (``jax.jvp``, ``jax.jacfwd``), and ignores correlations between axes of the bias in the
    given state. Use ``scan_steps`` where that matters.

    Args:
        params: as for ``step``. Known effects need the fast route, and the whole log in one call if they have a memory.
        state: before the first sample: from ``init``, or carried from an earlier part of the log.
        samples: leaves with a leading time axis (T, ...).
        options: as for ``step``.
        emit: selects what is kept of every sample, (state, info) -> pytree; by default the content of a result.
            ``keep_all`` keeps everything; what is not kept is not computed.

    Returns:
        the last state, to carry into the next part of the log, and what ``emit`` kept, with a leading time axis.
    """
    if samples.dt.shape[0] == 0:
        return scan_steps(params, state, samples, options, emit)
    last, staged = stages.run(params, state, samples, options)
    return last, jax.vmap(emit)(*_states_and_infos(params, state, samples, options, staged))


@partial(jax.jit, static_argnames=("options", "emit"))
def scan_steps(
    params: Params, state: State, samples: Sample, options: Options = DEFAULT_OPTIONS, emit: Emit = keep_result
) -> tuple[State, Any]:
    """The definition of filtering a log: ``lax.scan`` of ``step``, for any options; arguments as for ``run``."""

    def body(state: State, sample: Sample) -> tuple[State, Any]:
        state, info = step(params, state, sample, options)
        return state, emit(state, info)

    return jax.lax.scan(body, state, samples)


def _states_and_infos(
    params: Params, state: State, samples: Sample, options: Options, staged: Staged
) -> tuple[State, Info]:
    """What ``step`` reports for every sample, with a leading time axis, from what ``stages.run`` returned.

    All samples are computed together. XLA removes what is not used, so keeping the bias alone costs no covariances.
    """
    joint, wrench = staged.joint, staged.wrench
    log_likelihood = joint.log_likelihood.sum(1) + wrench.log_likelihood.sum(1)
    infos = Info(
        _of_joints(joint, samples, _joint_covariance(params, state, samples, options, joint)),
        _of_wrench(wrench, samples),
        staged.wrench_tool,
        log_likelihood,
    )
    return state_of(joint, wrench), infos


def _of_joints(track: Track, samples: Sample, covariance: Array) -> Innovation:
    """Innovations of (q, dq) with axes (T, n)."""
    measured = jnp.isfinite(jnp.stack([samples.q, samples.dq], 2))
    value = jnp.where(measured, jnp.swapaxes(track.innovation, 1, 2), jnp.nan)
    return Innovation(value, covariance, track.nis, track.log_likelihood, measured.sum(2))


def _of_wrench(track: Track, samples: Sample) -> Innovation:
    """Innovations of y = D theta - W; its axes are independent, so S is diagonal and the axes' shares add up."""
    # A sample that was not measured or did not pass the gate contributes exactly zero to the likelihood.
    measured = jnp.isfinite(samples.wrench) & (track.log_likelihood != 0)
    value = jnp.where(measured, track.innovation[:, 0], jnp.nan)
    covariance = diagonal_matrix(track.innovation_variance[:, 0])
    return Innovation(value, covariance, track.nis.sum(1), track.log_likelihood.sum(1), measured.sum(1))


def _joint_covariance(
    params: Params, state: State, samples: Sample, options: Options, track: Track
) -> Float[Array, "T n 2 2"]:
    """Covariance S (T, n, 2, 2) of the innovation of (q, dq).

    Its diagonal is in the track. The covariance between position and velocity comes from the prediction alone, because
    their noises are independent, and is recomputed from the state before each sample.
    """
    before = jnp.concatenate([jnp.moveaxis(state.joint.covariance, 0, -1)[None], track.covariance[:-1]])
    mean = jnp.concatenate([state.joint.mean.T[None], track.mean[:-1]])
    entries = [mean[:, a] for a in range(3)], [[before[:, a, b] for b in range(3)] for a in range(3)]
    restart = list((params.joint.prior_std**2)[:, None, None])
    dt, density = samples.dt[:, None], params.joint.process_density[None]
    _, predicted, _ = predict(JOINT_MODELS[options.joint_model], density, restart, entries, dt)
    q, dq = track.innovation_variance[:, 0], track.innovation_variance[:, 1]
    shared = predicted[0][1]
    return jnp.stack([jnp.stack([q, shared], -1), jnp.stack([shared, dq], -1)], -2)
