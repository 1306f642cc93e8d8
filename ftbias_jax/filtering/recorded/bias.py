"""The bias of a log whose joints are smoothed, sample by sample: at each what the wrench so far says."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.filtering import bias_filter
from ftbias_jax.filtering.adapt.contact import in_contact
from ftbias_jax.filtering.adapt.log_noise import LogNoise, useless
from ftbias_jax.filtering.fast.scan import Smoothed, filter_scan
from ftbias_jax.filtering.fast.stages import (
    bias_inputs,
    bias_state,
    gated,
    without_noise,
)
from ftbias_jax.filtering.filter_log import padded_length, start_at
from ftbias_jax.filtering.pipeline import Options, State
from ftbias_jax.filtering.recorded.prepare import Prepared
from ftbias_jax.filtering.result import Filtered
from ftbias_jax.filtering.samples import first_position, pad
from ftbias_jax.model.params import Params
from ftbias_jax.runtime.pieces import over_pieces
from ftbias_jax.types import Array, Gaussian, Sample


def filter_prepared(params: Params, parts: Iterable[Prepared], options: Options, noise: LogNoise) -> Iterator[Filtered]:
    """The bias of a log whose joints are smoothed.

    Args:
        params: of the pipeline, with the noise of the log (``with_noise``).
        parts: of ``prepare``, with the noise of single samples (``whole.with_variance``).
        options: of the pipeline.
        noise: contacts to leave out, and the inflation of the standard deviations.

    Yields:
        the result of every part; its log_likelihood is that of the part.
    """
    state = None
    for part in parts:
        touched = useless(part.log.t, noise)
        wrench = np.where(touched[:, None], np.nan, part.samples.wrench)
        length = len(part.log.t)
        room = padded_length(length)
        samples = pad(part.samples._replace(wrench=wrench), room)
        state = start_at(params, first_position(part.samples.q)) if state is None else state
        known = (part.wrench_tool, part.variance, part.joints.mean[:, 1], part.shown)
        at_samples = tuple(_lengthen(x, room) for x in known)
        state, kept = _filter_part(params, state, samples, at_samples, options, length)
        yield _result(part, {name: np.asarray(x)[:length] for name, x in kept.items()}, noise)


@partial(jax.jit, static_argnames="options")
def _filter_part(
    params: Params, state: State, samples: Sample, at_samples: tuple[Array, ...], options: Options, length: int
) -> tuple[State, dict[str, Array]]:
    """The bias filter over a part, whose first samples, so many, are of the log."""
    noise = params.bias

    def filtered(bias: Gaussian, piece: tuple[Sample, tuple[Array, ...]]) -> tuple[Gaussian, dict[str, Array]]:
        samples, (wrench_tool, variance, velocity, shown) = piece
        inputs = bias_inputs(params, state._replace(bias=bias), samples, wrench_tool, variance, velocity)
        track = without_noise(filter_scan(gated(inputs, options), inputs))
        std = jnp.sqrt(jnp.diagonal(track.covariance, axis1=1, axis2=2))  # (T, 6, k)
        motion = bias_filter.vibration(noise, velocity)
        correlated = 0.0 if noise.correlated_std is None else bias_filter.correlated_variance(noise, motion)
        used = jnp.isfinite(samples.wrench) & (track.log_likelihood != 0)
        innovation = jnp.where(used, track.innovation[:, 0], jnp.nan)
        innovation_variance = _judged(track.innovation_variance[:, 0] - variance, variance, shown)
        return bias_state(Smoothed(track.mean[-1], track.covariance[-1])), {
            "bias": track.mean[:, 0],
            "drift": track.mean[:, 1],
            "bias_std": std[:, :, 0],
            "drift_std": std[:, :, 1],
            "slow_error": jnp.zeros_like(samples.wrench) if track.mean.shape[1] == 2 else track.mean[:, 2],
            "innovation": innovation,
            "innovation_std": jnp.sqrt(innovation_variance),
            "nis": jnp.nansum(innovation**2 / innovation_variance, axis=1),
            "log_likelihood": track.log_likelihood.sum(1),
            "reading_std": jnp.sqrt(shown + jnp.broadcast_to(correlated, variance.shape)),
            "used": used.any(1),
        }

    bias, found = over_pieces(filtered, state.bias, (samples, at_samples), length)
    return state._replace(bias=bias), found


def _judged(predicted: Array, taken: Array, shown: Array) -> Array:
    """Variance of innovations if the noise of samples is ``shown``, and the filter took ``taken``; all (T, 6).

    The filter's own variance of what it predicts is noise of past samples for a half and process for the other, as in
    the steady state of a random walk: the first half is as much smaller, or larger, as the noise is.
    """
    return predicted * (1 + shown / taken) / 2 + shown


def _result(part: Prepared, kept: dict[str, Array], noise: LogNoise) -> Filtered:
    """The result of a part, at the stamps of its wrench."""
    log, rows = part.log, np.isfinite(part.log.wrench).any(1)
    nats = np.float64(kept.pop("log_likelihood").sum(dtype=np.float64) + part.joint_log_likelihood)
    columns = {name: x[rows] for name, x in kept.items()}
    known = part.known_bias[rows]
    bias, wrench_tool = columns.pop("bias") + known, part.wrench_tool[rows] + known
    unbiased = log.wrench[rows] + bias
    q, dq, ddq = (part.joints.mean[rows, i] for i in range(3))
    for name in ("bias_std", "drift_std"):
        columns[name] = columns[name] * noise.inflation
    return Filtered(
        t=log.t[rows] + log.start,
        bias=bias,
        wrench_unbiased=unbiased,
        q=q,
        dq=dq,
        ddq=ddq,
        ddq_std=np.sqrt(part.joints.covariance[rows, 2, 2]),
        wrench_tool=wrench_tool,
        log_likelihood=nats,
        contact_wrench=wrench_tool - unbiased,
        contact_wrench_std=np.hypot(columns["bias_std"], columns["reading_std"]),
        in_contact=in_contact(log.t[rows], list(noise.contacts)),
        **columns,
    )


def _lengthen(x: Array, length: int) -> Array:
    """An array (T, ...) with its last row repeated."""
    return np.pad(x, [(0, length - len(x)), *[(0, 0)] * (x.ndim - 1)], mode="edge")
