"""The method over a whole log (docs/pages/model.md) as one program of pure functions.

``METHOD`` names its passes in their order; each takes the log as far as it is known and adds to it. ``AS_STATED`` is
the filter as it would run on a robot: joints from the past alone, noise as the setup states it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.errors import UsageError
from ftbias_jax.filtering import bias_filter, pipeline
from ftbias_jax.filtering.joint_noise import MOST_SAMPLES, likeliest_density
from ftbias_jax.filtering.likelihood import measured_length
from ftbias_jax.filtering.method import bias, fit_noise, joints
from ftbias_jax.filtering.method.bias import Bias, innovation_variance, reading_variance
from ftbias_jax.filtering.method.blocks import (
    LEAST_BLOCKS,
    Blocks,
    Layout,
    in_blocks,
    jumps_in,
    layout_of,
    to_samples,
    without_jumps,
)
from ftbias_jax.filtering.method.fit_noise import Noise, from_median
from ftbias_jax.filtering.method.joints import Joints
from ftbias_jax.filtering.method.vibration import shown_variance, stated_shaking, taken_variance
from ftbias_jax.filtering.params_for_log import guard_against_lag
from ftbias_jax.filtering.pipeline import DEFAULT_OPTIONS, Options, State
from ftbias_jax.model.params import BiasNoise, Params
from ftbias_jax.runtime.compiled_loops import log_by_log_with_slopes, running_sum
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.types import Array, Sample

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

GATE = 6.0
"""Standard deviations: with the noise of the log, spikes and short contacts are off by more, and nothing else is."""


class States(NamedTuple):
    """A log at every sample; the joints given past and future (as stated: past alone), the bias given the past."""

    q: Float[Array, "T n"]
    """rad (m)."""
    dq: Float[Array, "T n"]
    """rad/s."""
    ddq: Float[Array, "T n"]
    """rad/s^2."""
    ddq_std: Float[Array, "T n"]
    """rad/s^2."""
    bias: Float[Array, "T 6"]
    """N, Nm; the corrected wrench is the reading plus this."""
    drift: Float[Array, "T 6"]
    """N/s, Nm/s."""
    bias_std: Float[Array, "T 6"]
    """N, Nm."""
    drift_std: Float[Array, "T 6"]
    """N/s, Nm/s."""
    slow_error: Float[Array, "T 6"]
    """N, Nm: of wrench_tool - reading what is correlated noise, not bias."""
    bias_smooth: Float[Array, "T 2 6"] | None = None
    """N, Nm and per s: bias and drift given past and future; None = not asked for."""
    bias_smooth_std: Float[Array, "T 2 6"] | None = None
    """Its standard deviation."""


class Infos(NamedTuple):
    """What the method learned at every sample and of the log."""

    wrench_tool: Float[Array, "T 6"]
    """N, Nm, sensor frame: what the tool causes."""
    wrench_unbiased: Float[Array, "T 6"]
    """N, Nm: the reading plus the bias; NaN = not measured."""
    innovation: Float[Array, "T 6"]
    """N, Nm; NaN = not used."""
    innovation_std: Float[Array, "T 6"]
    """N, Nm."""
    nis: Float[Array, " T"]
    """Normalised innovation squared, summed over the axes that were used."""
    used: Bool[Array, " T"]
    """Whether the sample passed the gate, and nothing touched the tool."""
    reading_std: Float[Array, "T 6"]
    """N, Nm: how far a reading is off wrench_tool - bias by all its noise."""
    log_likelihood: Float[Array, ""]
    """nats, of joints and wrench."""
    noise: Noise | None
    """What the log shows of its noise; None = the method was not to look, or the log is too short."""
    kept_out: Float[Array, ""]
    """Share of the free samples that the gate keeps out."""


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
    noise, found = fit_noise.fit_noise(work.params.bias, blocks, work.layout)
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


PASSES: dict[str, Callable[[Work], Work]] = {
    "fit_joint_noise": fit_joint_noise,
    "guard_joints": guard_joints,
    "smooth_joints": smooth_joints,
    "filter_joints": filter_joints,
    "fit_noise": fit_log_noise,
    "filter_bias": filter_bias,
    "begin_at_median": begin_at_median,
    "smooth_bias": smooth_bias,
}
METHOD = ("smooth_joints", "fit_noise", "filter_bias")
"""The passes over a recorded log, before ``summarise``."""
AS_STATED = ("filter_joints", "filter_bias")
"""Those of a filter on the robot."""


def filter_samples(
    params: Params,
    samples: Sample,
    options: Options = DEFAULT_OPTIONS,
    *,
    method: tuple[str, ...] = METHOD,
    layout: Layout | None = None,
) -> tuple[Params, States, Infos]:
    """Filter a log, as ``filter_log`` does: one program, to be mapped over logs and differentiated.

    Args:
        params: as ``params_for_log`` gives them; differentiable in every leaf. What the log shows of its noise counts
            as constant.
        samples: as ``samples_from_log`` gives them, leaves (T, ...); padding counts nothing.
        options: of the pipeline, as ``options_from_setup`` gives them where a setup states any.
        method: keys of PASSES in their order.
        layout: of the blocks that the noise is found in, as ``layout_of`` gives it; None = that of these samples.

    Returns:
        the parameters with the noise of the log, with which its bias was filtered, the states and the infos.

    Raises:
        UsageError: the samples are those of a program, and the layout is not given.
    """
    if layout is None:
        if isinstance(samples.dt, jax.core.Tracer):
            message = "is not given, and inside jax.jit, jax.vmap or jax.grad it cannot be read off the samples"
            raise UsageError(message, field="layout", remedy="give layout_of(dt) of one log")
        layout = layout_of(np.asarray(samples.dt))
    if len(samples.dt) // layout.size < LEAST_BLOCKS:
        method = tuple(name for name in method if name != "fit_noise")
    found: tuple[Params, States, Infos] = _filter(params, samples, options=options, method=method, layout=layout)
    return found


@keep_program("options", "method", "layout")
def _filter(
    params: Params, samples: Sample, *, options: Options, method: tuple[str, ...], layout: Layout
) -> tuple[Params, States, Infos]:
    def one(params: Params, samples: Sample) -> tuple[Params, States, Infos]:
        start = pipeline.init(params, samples)._replace(bias=None)
        work = Work(params, start, samples, running_sum(samples.dt), measured_length(samples), layout, options)
        for name in method:
            work = PASSES[name](work)
        return summarise(work)

    found: tuple[Params, States, Infos] = log_by_log_with_slopes(one)(params, samples)
    return found
