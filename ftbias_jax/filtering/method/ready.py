"""A recorded log filtered from its setup: the arrays of the method, back at the stamps of the wrench."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.filtering.method.bias import LEAST_USED
from ftbias_jax.filtering.method.by_parts import filter_parts
from ftbias_jax.filtering.method.filter_samples import AS_STATED, METHOD, filter_samples
from ftbias_jax.filtering.method.results import Infos, States
from ftbias_jax.filtering.noise.blocks import layout_of
from ftbias_jax.filtering.noise.contact import Contact, in_contact
from ftbias_jax.filtering.noise.fit_noise import without_nothing
from ftbias_jax.filtering.noise.log_noise import LogNoise, nothing, told
from ftbias_jax.filtering.params_for_log import stated_params, without_useless
from ftbias_jax.filtering.pipeline import options_from_setup
from ftbias_jax.filtering.result import Filtered
from ftbias_jax.filtering.samples import arrays_from_log, first_position, pad, without_unsettled
from ftbias_jax.io.cleaning import slices
from ftbias_jax.io.log import Log
from ftbias_jax.model.params import Params
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array, Sample

MOST = 1 << 19
"""Samples of a log that are worked on at once; a longer one passes in parts, so that memory does not grow with it."""


class Ready(NamedTuple):
    """What a log was filtered with, and its results part by part."""

    params: Params
    """With the noise of the log."""
    noise: LogNoise
    results: Iterable[Filtered]
    smoothed: Mapping[str, Array] = MappingProxyType({})
    """The bias given past and future, by the names of the output file, if it was asked for."""


def ready_to_filter(
    setup: Setup, parts: Callable[[int], Iterator[Log]], length: int, first_q: Array, *, smooth: bool = False
) -> Ready:
    """Filter a log: joints smoothed, noise of the log found; or as stated, where ``[bias] adapt = false`` asks for it.

    Args:
        setup: of the log.
        parts: samples at once -> the log, read in parts.
        length: samples of the log.
        first_q: (n,) rad, the first measured position of every joint.
        smooth: add the bias given past and future.
    """
    options, adapt = options_from_setup(setup), setup.bias.adapt
    params = stated_params(setup, first_q)
    slow = params.bias.correlated_std is not None
    first = ("fit_joint_noise",) if setup.joints.process_noise_density is None else ()
    method = (*first, *METHOD) if adapt else (*first, "guard_joints", *AS_STATED)
    if length > MOST and params.effects is None and not smooth:
        taken, found, layout, results = filter_parts(params, parts, first_q, options, method)
        noise = nothing() if found is None else told(found, layout, slow_is_stated=slow)
        return Ready(as_stated(taken), noise, (result_of(*part, noise.contacts if adapt else None) for part in results))
    (log,) = parts(length)
    log = without_useless(log, params)
    samples = samples_of(params, log)
    layout = layout_of(samples.dt)

    def run(method: tuple[str, ...]) -> tuple[Params, States, Infos]:
        found: tuple[Params, States, Infos] = jax.tree.map(
            np.asarray, filter_samples(params, samples, options, method=method, layout=layout)
        )
        return found

    last = ("smooth_bias",) if smooth and adapt else ()
    taken, states, infos = run((*method, *last))
    if infos.noise is None:
        noise = nothing()
    else:
        noise = told(infos.noise, layout, slow_is_stated=slow)
        if infos.kept_out > 1 - LEAST_USED:
            again = run((*method[:-1], "begin_at_median", "filter_bias", *last))
            if better := again[2].kept_out < infos.kept_out:
                taken, states, infos = again
            kept_out = float(infos.kept_out) if infos.kept_out > 1 - LEAST_USED else 0.0
            noise = noise._replace(begun_again=bool(better), kept_out=kept_out)
    smoothed = states
    if smooth and not adapt:  # smoothed joints have no lag, so their process noise is not guarded
        smoothed = run((*first, "smooth_joints", "filter_bias", "smooth_bias"))[1]
    noise = noise._replace(contacts=in_log_time(noise.contacts, samples.dt, log.t))
    result = result_of(log, states, infos, noise.contacts if adapt else None)
    return Ready(as_stated(taken), noise, [result], _smoothed(smoothed, log))


def as_stated(params: Params) -> Params:
    """Parameters of JAX, without noise that is zero."""
    found: Params = jax.tree.map(jnp.asarray, params._replace(bias=without_nothing(params.bias)))
    return found


def in_log_time(contacts: Sequence[Contact], dt: Array, t: Array) -> tuple[Contact, ...]:
    """Contacts whose times are sums of dt, which counts a long pause as shorter than it was, by the stamps t (T,) s."""
    passed = np.cumsum(dt[: len(t)])
    late = np.interp([(contact.start, contact.end) for contact in contacts], passed, t - passed) if contacts else []
    return tuple(x._replace(start=x.start + by[0], end=x.end + by[1]) for x, by in zip(contacts, late, strict=True))


def samples_of(params: Params, log: Log) -> Sample:
    """A whole log as the method's input, padded so that logs of similar length share a program; NumPy arrays."""
    samples = without_unsettled(arrays_from_log(log, params.theta.dtype), log.t, params)
    samples = samples if params.effects is not None else samples._replace(temperature=None, columns=None)
    return pad(samples, room_for(len(log.t)))


def room_for(length: int) -> int:
    """Samples of the shortest program that takes so many: 512, 768, 1024, 1536 and so on."""
    half = 1 << max(0, (length - 1).bit_length() - 1)
    return max(512, half + half // 2 if length <= half + half // 2 else 2 * half)


def result_of(log: Log, states: States, infos: Infos, contacts: Sequence[Contact] | None) -> Filtered:
    """The result of a log or of a part of one, at the stamps of its wrench.

    Args:
        log: as filtered.
        states: of the method, which may go on with padding.
        infos: of the method.
        contacts: of the whole log; None = the log was filtered as on the robot, where nobody knows them.
    """
    rows = np.isfinite(log.wrench).any(1)
    at: slice | Array = slice(len(rows)) if rows.all() else np.flatnonzero(rows)
    wrench_unbiased, bias_std, reading_std = infos.wrench_unbiased[at], states.bias_std[at], infos.reading_std[at]
    wrench_tool = infos.wrench_tool[at]
    filtered = Filtered(
        t=log.t[at] + log.start,
        bias=states.bias[at],
        drift=states.drift[at],
        bias_std=bias_std,
        drift_std=states.drift_std[at],
        wrench_unbiased=wrench_unbiased,
        q=states.q[at],
        dq=states.dq[at],
        ddq=states.ddq[at],
        ddq_std=states.ddq_std[at],
        wrench_tool=wrench_tool,
        innovation=infos.innovation[at],
        nis=infos.nis[at],
        log_likelihood=np.float64(infos.log_likelihood),
        innovation_std=infos.innovation_std[at],
    )
    if contacts is None:
        return filtered
    return filtered._replace(
        used=infos.used[at],
        reading_std=reading_std,
        slow_error=states.slow_error[at],
        contact_wrench=wrench_tool - wrench_unbiased,
        contact_wrench_std=np.hypot(bias_std, reading_std),
        in_contact=in_contact(log.t, contacts)[at],
    )


def _smoothed(states: States, log: Log) -> dict[str, Array]:
    """The bias given past and future, by the names of the output file; none if it was not asked for."""
    if states.bias_smooth is None or states.bias_smooth_std is None:
        return {}
    rows = np.flatnonzero(np.isfinite(log.wrench).any(1))
    mean, std = states.bias_smooth[rows], states.bias_smooth_std[rows]
    return {
        "bias_smooth": mean[:, 0],
        "drift_smooth": mean[:, 1],
        "bias_smooth_std": std[:, 0],
        "drift_smooth_std": std[:, 1],
    }


def filtered_with(setup: Setup, log: Log) -> tuple[Filtered, Params]:
    """A log filtered as ``ftbias filter`` does it, and the parameters that the filter took."""
    ready = ready_to_filter(setup, slices(log), len(log.t), first_position(log.q))
    (filtered,) = ready.results
    return filtered, ready.params
