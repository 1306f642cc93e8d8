"""State and info of every sample, as ``step`` reports them, from the tracks of the stages.

Everything is worked out for all samples at once, and XLA leaves out what nobody reads: a caller who keeps the bias
alone does not pay for the covariances.
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from ftbias_jax.filtering.fast.kalman_step import predict
from ftbias_jax.filtering.fast.scan import Track
from ftbias_jax.filtering.fast.stages import Staged, diagonal_matrix, state_of
from ftbias_jax.filtering.gaussian import Innovation
from ftbias_jax.filtering.process_models import JOINT_MODELS
from ftbias_jax.filtering.step import Info, Options, State
from ftbias_jax.model.params import Params
from ftbias_jax.types import Sample


def states_and_infos(
    params: Params, state: State, samples: Sample, options: Options, staged: Staged
) -> tuple[State, Info]:
    """What ``step`` reports of every sample, with a leading time axis.

    Args:
        params: as for ``stages.run``.
        state: before the first sample.
        samples: the log, leaves (T, ...).
        options: as for ``stages.run``.
        staged: what ``stages.run`` returned.
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
    # What was not measured, or did not pass the gate, has no share in the likelihood: exactly zero.
    measured = jnp.isfinite(samples.wrench) & (track.log_likelihood != 0)
    value = jnp.where(measured, track.innovation[:, 0], jnp.nan)
    covariance = diagonal_matrix(track.innovation_variance[:, 0])
    return Innovation(value, covariance, track.nis.sum(1), track.log_likelihood.sum(1), measured.sum(1))


def _joint_covariance(
    params: Params, state: State, samples: Sample, options: Options, track: Track
) -> Float[Array, "T n 2 2"]:
    """(T, n, 2, 2) covariance S of the innovation of (q, dq).

    Its diagonal is in the track. What position and velocity share comes from the prediction alone, because their noises
    are independent, and is worked out again from the state before each sample.
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
