"""The bias of a log whose joints are known, sample by sample: at each what the wrench so far says."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import jax.numpy as jnp

from ftbias_jax.filtering import bias_filter
from ftbias_jax.filtering.fast.scan import Smoothed, filter_scan
from ftbias_jax.filtering.fast.stages import add_noise, bias_inputs, bias_state, gated
from ftbias_jax.filtering.method.joints import Joints
from ftbias_jax.filtering.smoother import smooth_axes
from ftbias_jax.filtering.step import Options, State
from ftbias_jax.model.params import Params
from ftbias_jax.runtime.pieces import over_pieces
from ftbias_jax.types import Array, Gaussian, Sample

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

LEAST_USED = 0.5
"""Share of the samples free of contact that the gate must let through; contacts are found before, and do not count."""


class Bias(NamedTuple):
    """Bias and drift at every sample, and what the filter learned there."""

    bias: Float[Array, "T 6"]
    """N, Nm."""
    drift: Float[Array, "T 6"]
    """N/s, Nm/s."""
    bias_std: Float[Array, "T 6"]
    """N, Nm."""
    drift_std: Float[Array, "T 6"]
    """N/s, Nm/s."""
    slow_error: Float[Array, "T 6"]
    """N, Nm: of wrench_tool - reading what is correlated noise, not bias."""
    innovation: Float[Array, "T 6"]
    """N, Nm; NaN = not used."""
    predicted: Float[Array, "T 6"]
    """N^2, Nm^2, variance of the innovation without the noise of the sample itself."""
    log_likelihood: Float[Array, ""]
    """nats."""

    @property
    def used(self) -> Bool[Array, " T"]:
        """Whether the sample passed the gate, and nothing touched the tool."""
        return jnp.isfinite(self.innovation).any(1)


def filter_bias(
    params: Params,
    state: State,
    samples: Sample,
    joints: Joints,
    variance: Float[Array, "T 6"],
    length: Array,
    options: Options,
) -> tuple[State, Bias]:
    """Filter the bias of a log, or of a part of one.

    Args:
        params: of the pipeline, with the noise of the log.
        state: before the first sample.
        samples: leaves (T, ...); the wrench is NaN where it is not to be used.
        joints: of these samples.
        variance: (T, 6) N^2, Nm^2, diagonal of R.
        length: samples at the start that count.
        options: of the pipeline.
    """
    known = (joints.wrench_tool, variance, joints.mean[1])

    def filtered(before: Gaussian, piece: tuple[Sample, tuple[Array, ...]]) -> tuple[Gaussian, Bias]:
        samples, (wrench_tool, variance, velocity) = piece
        inputs = bias_inputs(params, state._replace(bias=before), samples, wrench_tool, variance, velocity)
        track = filter_scan(gated(inputs, options), inputs)
        # What was not measured, or did not pass the gate, has no share in the likelihood: exactly zero.
        used = jnp.isfinite(samples.wrench) & (track.log_likelihood != 0)
        x, P = track.mean, track.covariance
        slow = jnp.zeros_like(wrench_tool)
        bias, variance_of_bias = x[:, 0], P[:, 0, 0]
        if x.shape[1] == 3:  # the first state is bias and slow error together
            bias, slow = bias - x[:, 2], x[:, 2]
            variance_of_bias = variance_of_bias - 2 * P[:, 0, 2] + P[:, 2, 2]
        found = Bias(
            bias,
            x[:, 1],
            jnp.sqrt(variance_of_bias),
            jnp.sqrt(P[:, 1, 1]),
            slow,
            jnp.where(used, track.innovation[:, 0], jnp.nan),
            track.innovation_variance[:, 0] - variance,
            track.log_likelihood.sum()[None],
        )
        last = add_noise(x[-1], P[-1], -1)
        return bias_state(Smoothed(*last)), found

    last, found = over_pieces(filtered, state.bias, (samples, known), length)
    return state._replace(bias=last), found._replace(log_likelihood=found.log_likelihood.sum())


def smooth_bias(
    params: Params, state: State, samples: Sample, joints: Joints, variance: Float[Array, "T 6"], bias: Bias
) -> tuple[Float[Array, "T 2 6"], Float[Array, "T 2 6"]]:
    """Bias and drift given the whole log, from the samples that passed the gate: means and standard deviations.

    Arguments as for ``filter_bias``, with what that gave.
    """
    passed = samples._replace(wrench=jnp.where(jnp.isfinite(bias.innovation), samples.wrench, jnp.nan))
    inputs = bias_inputs(params, state, passed, joints.wrench_tool, variance, joints.mean[1])
    found: tuple[Array, Array] = smooth_axes(inputs)
    return found


def innovation_variance(bias: Bias, taken: Float[Array, "T 6"], shown: Float[Array, "T 6"]) -> Float[Array, "T 6"]:
    """Variance of innovations if the noise of samples is ``shown``, and the filter took ``taken``; N^2, Nm^2.

    The filter's own variance of what it predicts is noise of past samples for a half and process for the other, as in
    the steady state of a random walk: the first half is as much smaller, or larger, as the noise is.
    """
    return bias.predicted * (1 + shown / jnp.where(taken > 0, taken, 1)) / 2 + shown


def reading_variance(params: Params, shown: Float[Array, "T 6"], velocity: Float[Array, "T n"]) -> Float[Array, "T 6"]:
    """N^2, Nm^2: how far a reading is off wrench_tool - bias by all its noise, white and correlated."""
    noise = params.bias
    if noise.correlated_std is None:
        return shown
    more = bias_filter.correlated_variance(noise, bias_filter.vibration(noise, velocity))
    return shown + jnp.broadcast_to(more, shown.shape)
