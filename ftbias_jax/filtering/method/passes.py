"""The passes of the method: each takes a log as far as it is known, and adds to that."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp

from ftbias_jax.filtering import bias_filter
from ftbias_jax.filtering.joint_noise import MOST_SAMPLES, likeliest_density
from ftbias_jax.filtering.method import bias, joints
from ftbias_jax.filtering.method.bias import Bias, innovation_variance, reading_variance
from ftbias_jax.filtering.method.joints import Joints
from ftbias_jax.filtering.method.results import Infos, States
from ftbias_jax.filtering.noise.blocks import Blocks, Layout, in_blocks, jumps_in, to_samples, without_jumps
from ftbias_jax.filtering.noise.fit_noise import Noise, fit_noise, from_median
from ftbias_jax.filtering.noise.vibration import shown_variance, stated_shaking, taken_variance
from ftbias_jax.filtering.params_for_log import guard_against_lag
from ftbias_jax.filtering.pipeline import Options, State
from ftbias_jax.model.params import BiasNoise, Params
from ftbias_jax.types import Array, Sample

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

GATE = 6.0
"""Standard deviations: with the noise of the log, spikes and short contacts are off by more, and nothing else is."""


class Work(NamedTuple):
    """A log as far as it is known; every pass of the method adds to it."""

    params: Params
    start: State
    """Before the first sample; its bias is None where it begins with the prior."""
    samples: Sample
    t: Float[Array, " T"]
    """s, since the log began."""
    length: Array
    """Samples at the start that count."""
    layout: Layout
    options: Options
    seen: Array | None = None
    """Samples that are not padding, some of which may be of the next part of the log; None = those that count."""
    joints: Joints | None = None
    stated: Params | None = None
    """Parameters before the log's noise was added to them."""
    noise: Noise | None = None
    blocks: Blocks | None = None
    touched: Bool[Array, " T"] | None = None
    """Samples in contact or near it, which are left out."""
    bias: Bias | None = None
    smoothed: tuple[Array, Array] | None = None
    end: State | None = None
    """After the last sample that counts."""


def fit_joint_noise(work: Work) -> Work:
    """The joints' process noise of maximum likelihood, of the first samples of the log."""
    params, (dt, q, dq, *_) = work.params, jax.tree.map(lambda x: x[:MOST_SAMPLES], work.samples)
    measured = jax.lax.stop_gradient((params.joint, dt, q, dq))
    density = likeliest_density(*measured, model=work.options.joint_model)
    return work._replace(params=params._replace(joint=params.joint._replace(process_density=density)))


def guard_joints(work: Work) -> Work:
    """The joints' process noise guarded against the lag of a filter."""
    return work._replace(params=guard_against_lag(work.params))


def smooth_joints(work: Work) -> Work:
    """Joints given past and future, and the wrench that the tool must cause."""
    log = (work.params, work.start, work.samples, work.length, work.options)
    end, found = joints.smooth_joints(*log, work.seen)
    return work._replace(joints=found, end=end)


def filter_joints(work: Work) -> Work:
    """The same from the past alone."""
    end, found = joints.filter_joints(work.params, work.start, work.samples, work.length, work.options)
    return work._replace(joints=found, end=end)


def fit_log_noise(work: Work) -> Work:
    """Contact, noise in motion and slow errors where the setup leaves them open, by the blocks of the log."""
    blocks, rezeroed = blocks_of(work), work.samples.rezeroed
    if rezeroed is not None:
        blocks = without_jumps(blocks, jumps_in(work.layout, rezeroed))
    noise, found = fit_noise(work.params.bias, blocks, work.layout)
    touched = to_samples(work.layout, found.contacts.near, len(work.t))
    return with_noise(work, noise, found)._replace(blocks=blocks, touched=touched)


def blocks_of(work: Work) -> Blocks:
    """The log in blocks, with jumps where the sensor was set to zero."""
    known = work.joints
    assert known is not None
    velocity, y = known.mean[1], known.wrench_tool - work.samples.wrench
    shaking = stated_shaking(work.params.bias, velocity)
    return in_blocks(work.layout, work.t, y, velocity, known.variance, shaking, work.length)


def with_noise(work: Work, noise: BiasNoise, found: Noise) -> Work:
    """A log with the noise that was found in the whole of it, and the gate that goes with that."""
    options = work.options if work.options.gate is not None else work.options._replace(gate=GATE)
    return work._replace(params=work.params._replace(bias=noise), stated=work.params, noise=found, options=options)


def filter_bias(work: Work) -> Work:
    """The bias sample by sample: at each what the wrench so far says."""
    assert work.end is not None
    assert work.joints is not None
    prior, free = bias_filter.init(work.params.bias), without_contact(work)
    state = work.start if work.start.bias is not None else work.start._replace(bias=prior)
    variance = _variances(work)[0]
    end, found = bias.filter_bias(work.params, state, free, work.joints, variance, work.length, work.options)
    return work._replace(bias=found, end=work.end._replace(bias=end.bias))


def without_contact(work: Work) -> Sample:
    """The samples without those in contact."""
    if work.touched is None:
        return work.samples
    return work.samples._replace(wrench=jnp.where(work.touched[:, None], jnp.nan, work.samples.wrench))


def begin_at_median(work: Work) -> Work:
    """Let the bias begin at the median of the log, for a log that the gate keeps out most of.

    The gate takes for contact what is off its prediction, and the prediction rests on the readings that passed before:
    with little noise a few odd ones at the start keep it shut for the rest of a short log.
    """
    assert work.noise is not None
    assert work.blocks is not None
    return work._replace(params=work.params._replace(bias=from_median(work.params.bias, work.noise, work.blocks)))


def smooth_bias(work: Work) -> Work:
    """The bias given past and future, from the samples that the filter used."""
    assert work.joints is not None
    assert work.bias is not None
    start = work.start._replace(bias=bias_filter.init(work.params.bias))
    found = bias.smooth_bias(work.params, start, work.samples, work.joints, _variances(work)[0], work.bias)
    return work._replace(smoothed=found)


def summarise(work: Work) -> tuple[Params, States, Infos]:
    """Parameters of the log, its states and its infos."""
    known, found, noise = work.joints, work.bias, work.noise
    assert known is not None
    assert found is not None
    taken, shown = _variances(work)
    innovation_std = _root(innovation_variance(found, taken, shown))
    passed = jnp.isfinite(found.innovation)
    standard = jnp.where(passed, found.innovation, 0) / jnp.where(passed, innovation_std, 1)
    inflation = jnp.ones(6, found.bias.dtype) if noise is None else noise.inflation
    added = 0 if known.known_bias is None else known.known_bias
    q, dq, ddq = known.mean
    errors = (found.bias_std * inflation[None], found.drift_std * inflation[None])
    states = States(q, dq, ddq, known.ddq_std, found.bias + added, found.drift, *errors, found.slow_error)
    if work.smoothed is not None:
        smooth, smooth_std = work.smoothed
        smooth = smooth.at[:, 0].add(added)
        states = states._replace(bias_smooth=smooth, bias_smooth_std=smooth_std * inflation[None, None])
    infos = Infos(
        wrench_tool=known.wrench_tool + added,
        wrench_unbiased=work.samples.wrench + states.bias,
        innovation=found.innovation,
        innovation_std=innovation_std,
        nis=(standard**2).sum(1),
        used=found.used,
        reading_std=_root(reading_variance(work.params, shown, dq)),
        log_likelihood=found.log_likelihood + known.log_likelihood,
        noise=noise,
        kept_out=1 - found.used.sum() / jnp.maximum(_free(work), 1),
    )
    return work.params, states, infos


def _root(variance: Array) -> Array:
    """Square root with a finite slope at 0, where padding is."""
    there = variance > 0
    return jnp.where(there, jnp.sqrt(jnp.where(there, variance, 1)), 0)


def _variances(work: Work) -> tuple[Array, Array]:
    """(T, 6) N^2, Nm^2: noise of single samples that the filter takes, and that the log shows."""
    assert work.joints is not None
    stated = work.joints.variance
    if work.noise is None or work.stated is None:
        return stated, stated
    found = (work.stated.bias, work.noise.vibration, stated, work.joints.mean[1])
    return taken_variance(*found), shown_variance(*found)


def _free(work: Work) -> Array:
    """() how many samples there are to be used."""
    return jnp.isfinite(without_contact(work).wrench).any(1).sum()
