"""The passes over noise and bias of a log whose joints are known: each takes what is known of a log and adds to it."""

import jax.numpy as jnp
from jaxtyping import Bool, Float

from ftbias_jax.filtering import bias_filter
from ftbias_jax.filtering.fast.scan import Smoothed, filter_scan
from ftbias_jax.filtering.fast.stages import add_noise, bias_inputs, bias_state, gated
from ftbias_jax.filtering.method.work import Infos, States, Work
from ftbias_jax.filtering.noise.blocks import Blocks, in_blocks, jumps_in, to_samples, without_jumps
from ftbias_jax.filtering.noise.fit_noise import Noise, from_median
from ftbias_jax.filtering.noise.fit_noise import fit_noise as noise_of_log
from ftbias_jax.filtering.noise.vibration import shown_variance, stated_shaking, taken_variance
from ftbias_jax.filtering.smoother import smooth_axes
from ftbias_jax.model.params import BiasNoise, Params
from ftbias_jax.runtime.compiled_loops import over_pieces
from ftbias_jax.types import Array, Gaussian, Sample

GATE = 6.0
"""Standard deviations: with the noise of the log, spikes and short contacts are off by more, and nothing else is."""
AT_FIRST = 1.0
"""s from the first free sample, within which a trustworthy gate must reopen after a few odd readings have closed it."""


def fit_noise(work: Work) -> Work:
    """Find contact, noise in motion and slow errors where the setup leaves them open, from the blocks of the log."""
    blocks, rezeroed = blocks_of(work), work.samples.rezeroed
    if rezeroed is not None:
        blocks = without_jumps(blocks, jumps_in(work.layout, rezeroed))
    noise, found = noise_of_log(work.params.bias, blocks, work.layout)
    touched = to_samples(work.layout, found.contacts.near, len(work.t))
    return with_noise(work, noise, found)._replace(blocks=blocks, touched=touched)


def blocks_of(work: Work) -> Blocks:
    """The log in blocks, with jumps where the sensor was set to zero."""
    velocity, y = work.speeds, work.joints.wrench_tool - work.samples.wrench
    shaking = stated_shaking(work.params.bias, velocity)
    weighs = (work.params.gravity != 0).any()
    variance, tool = work.joints.variance, jnp.where(weighs, work.joints.wrench_tool, 0)
    return in_blocks(work.layout, work.t, y, velocity, variance, shaking, work.length, tool)


def with_noise(work: Work, noise: BiasNoise, found: Noise) -> Work:
    """A log with the noise that was found in the whole of it, and the gate that belongs to it."""
    options = work.options if work.options.gate is not None else work.options._replace(gate=GATE)
    return work._replace(params=work.params._replace(bias=noise), stated=work.params, noise=found, options=options)


def filter_bias(work: Work) -> Work:
    """Filter the bias forward: at each sample it is the estimate from the wrench so far."""
    params, joints, variance = work.params, work.joints, _variances(work)[0]
    state = work.start if work.start.bias is not None else work.start._replace(bias=bias_filter.init(params.bias))

    def filtered(before: Gaussian, piece: tuple[Sample, tuple[Array, ...]]) -> tuple[Gaussian, tuple[Array, ...]]:
        samples, (wrench_tool, variance, velocity) = piece
        inputs = bias_inputs(params, state._replace(bias=before), samples, wrench_tool, variance, velocity)
        track = filter_scan(gated(inputs, work.options), inputs)
        # A sample that was not measured or did not pass the gate contributes exactly zero to the likelihood.
        used = jnp.isfinite(samples.wrench) & (track.log_likelihood != 0)
        x, P = track.mean, track.covariance
        slow = jnp.zeros_like(wrench_tool)
        bias, variance_of_bias = x[:, 0], P[:, 0, 0]
        if x.shape[1] == 3:  # the first state is bias and slow error together
            bias, slow = bias - x[:, 2], x[:, 2]
            variance_of_bias = variance_of_bias - 2 * P[:, 0, 2] + P[:, 2, 2]
        innovation = jnp.where(used, track.innovation[:, 0], jnp.nan)
        predicted = track.innovation_variance[:, 0] - variance
        found = (bias, x[:, 1], jnp.sqrt(variance_of_bias), jnp.sqrt(P[:, 1, 1]), slow)
        last = bias_state(Smoothed(*add_noise(x[-1], P[-1], -1)))
        return last, (*found, innovation, predicted, track.log_likelihood.sum()[None])

    known = (joints.wrench_tool, variance, work.speeds)
    last, found = over_pieces(filtered, state.bias, (_without_contact(work), known), work.length)
    *found, innovation, predicted, nats = found
    work = work._replace(states=States(*joints.mean, joints.ddq_std, *found), end=work.end._replace(bias=last))
    return work._replace(innovation=innovation, predicted=predicted, log_likelihood=nats.sum())


def begin_at_median(work: Work) -> Work:
    """Let the bias begin at the median of the log, for a log that the gate rejects most of.

    The gate takes what is off its prediction for contact, and the prediction relies on the readings that passed before:
    with little noise, a few odd ones at the start keep the gate closed for the rest of a short log.
    """
    assert work.noise is not None
    return work._replace(params=work.params._replace(bias=from_median(work.params.bias, work.noise, work.blocks)))


def smooth_bias(work: Work) -> Work:
    """Bias and drift given past and future, from the samples that the filter used: means and standard deviations."""
    start = work.start._replace(bias=bias_filter.init(work.params.bias))
    passed = jnp.where(jnp.isfinite(work.innovation), work.samples.wrench, jnp.nan)
    known = (work.joints.wrench_tool, _variances(work)[0], work.speeds)
    inputs = bias_inputs(work.params, start, work.samples._replace(wrench=passed), *known)
    mean, std = smooth_axes(inputs)
    return work._replace(states=work.states._replace(bias_smooth=mean, bias_smooth_std=std))


def summarise(work: Work) -> tuple[Params, States, Infos]:
    """Parameters, states and infos of the log."""
    known, states, noise, innovation = work.joints, work.states, work.noise, work.innovation
    taken, shown = _variances(work)
    innovation_std = _root(_innovation_variance(work.predicted, taken, shown))
    passed = jnp.isfinite(innovation)
    standard = jnp.where(passed, innovation, 0) / jnp.where(passed, innovation_std, 1)
    inflation = jnp.ones(6, innovation.dtype) if noise is None else noise.inflation
    hidden = jnp.zeros(6, innovation.dtype) if noise is None else noise.hidden
    bias_std = jnp.hypot(states.bias_std * inflation[None], hidden[None])
    drift_std = states.drift_std * inflation[None]
    states = states._replace(bias=states.bias + known.known_bias, bias_std=bias_std, drift_std=drift_std)
    if states.bias_smooth is not None and states.bias_smooth_std is not None:
        smooth_std = states.bias_smooth_std * inflation[None, None]
        smooth_std = smooth_std.at[:, 0].set(jnp.hypot(smooth_std[:, 0], hidden[None]))
        states = states._replace(
            bias_smooth=states.bias_smooth.at[:, 0].add(known.known_bias), bias_smooth_std=smooth_std
        )
    used, free = passed.any(1), jnp.isfinite(_without_contact(work).wrench).any(1)
    first = jnp.where(free, work.t, jnp.inf).min()
    infos = Infos(
        wrench_tool=known.wrench_tool + known.known_bias,
        wrench_unbiased=work.samples.wrench + states.bias,
        innovation=innovation,
        innovation_std=innovation_std,
        nis=(standard**2).sum(1),
        used=used,
        reading_std=_root(_reading_variance(work.params.bias, shown, work.speeds)),
        log_likelihood=work.log_likelihood + known.log_likelihood,
        noise=noise,
        kept_out=_kept_out(used, free),
        kept_out_at_first=_kept_out(used, free & (work.t <= first + AT_FIRST)),
    )
    return work.params, states, infos


def _kept_out(used: Bool[Array, " T"], free: Bool[Array, " T"]) -> Array:
    """Share of the free samples that were not used."""
    return 1 - (used & free).sum() / jnp.maximum(free.sum(), 1)


def _without_contact(work: Work) -> Sample:
    """The samples without those in contact."""
    if work.touched is None:
        return work.samples
    return work.samples._replace(wrench=jnp.where(work.touched[:, None], jnp.nan, work.samples.wrench))


def _variances(work: Work) -> tuple[Array, Array]:
    """Noise variances of single samples, (T, 6) N^2, Nm^2, that the filter uses and that the log shows."""
    stated = work.joints.variance
    if work.noise is None or work.stated is None:
        return stated, stated
    found = (work.stated.bias, work.noise.vibration, stated, work.speeds)
    return taken_variance(*found), shown_variance(*found)


def _innovation_variance(predicted: Array, taken: Float[Array, "T 6"], shown: Float[Array, "T 6"]) -> Array:
    """Variance of innovations if the noise of samples is ``shown`` and the filter used ``taken``; N^2, Nm^2.

    Half of the filter's own variance of its prediction is noise of past samples and half is process noise, as in the
    steady state of a random walk: the first half scales with the noise.
    """
    return predicted * (1 + shown / jnp.where(taken > 0, taken, 1)) / 2 + shown


def _reading_variance(noise: BiasNoise, shown: Float[Array, "T 6"], velocity: Float[Array, "T n"]) -> Array:
    """Variance (T, 6) N^2, Nm^2 of a reading about wrench_tool - bias from all its noise, white and correlated."""
    if noise.correlated_std is None:
        return shown
    more = bias_filter.correlated_variance(noise, bias_filter.vibration(noise, velocity))
    return shown + jnp.broadcast_to(more, shown.shape)


def _root(variance: Array) -> Array:
    """Square root with a finite derivative at 0, the value of padding."""
    there = variance > 0
    return jnp.where(there, jnp.sqrt(jnp.where(there, variance, 1)), 0)
