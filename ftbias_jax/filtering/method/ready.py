"""Filter a recorded log from its setup, with the arrays of the method at the stamps of the wrench."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.filtering.method.by_parts import filter_parts
from ftbias_jax.filtering.method.filter_samples import AS_STATED, METHOD
from ftbias_jax.filtering.method.runs import Run, Steps, alone
from ftbias_jax.filtering.method.work import Infos, States
from ftbias_jax.filtering.noise.blocks import layout_of
from ftbias_jax.filtering.noise.contact import Contact, in_contact
from ftbias_jax.filtering.noise.fit_noise import drop_zero_terms
from ftbias_jax.filtering.noise.joint_scatter import no_less_than_shown
from ftbias_jax.filtering.noise.log_noise import LogNoise, log_noise_from, nothing
from ftbias_jax.filtering.params_for_log import without_useless, zeroed_at
from ftbias_jax.filtering.pipeline import options_from_setup
from ftbias_jax.filtering.result import ARRAYS, Filtered
from ftbias_jax.filtering.samples import first_position, samples_of
from ftbias_jax.io.cleaning import slices
from ftbias_jax.io.log import Log
from ftbias_jax.model.params import Params, params_from_setup
from ftbias_jax.runtime.jax_config import is_float64
from ftbias_jax.runtime.kept_programs import compiled_for_few_calls
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

LEAST_USED = 0.5
"""Share of the samples free of contact that the gate must pass; contacts are found before and do not count."""
MOST = 1 << 19
"""Samples of a log processed together; a longer one is processed in parts, so that memory does not grow with it."""


class Prepared(NamedTuple):
    """Parameters and noise that a log was filtered with, and its results part by part; a whole log is one part."""

    params: Params
    """Parameters with the noise of the log."""
    noise: LogNoise
    results: Iterable[Filtered]


def ready_to_filter(
    setup: Setup, parts: Callable[[int], Iterator[Log]], length: int, first_q: Array, *, smooth: bool = False
) -> Steps[Prepared]:
    """Filter a log: joints smoothed, noise of the log found; or as stated, where ``[bias] adapt = false``.

    ``parts``: samples per part -> the log in parts. With ``smooth`` the bias given past and future is added.
    """
    options, adapt = options_from_setup(setup), setup.bias.adapt
    params = zeroed_at(_params_of(setup, is_float64()), setup, first_q)
    slow = params.bias.correlated_std is not None
    first = ("fit_joint_noise",) if setup.joints.process_noise_density is None else ()
    method = (*first, *METHOD) if adapt else (*first, "guard_joints", *AS_STATED)
    if length > MOST and params.effects is None and not smooth:
        taken, found, layout, results = filter_parts(params, parts, first_q, options, method)
        noise = nothing() if found is None else log_noise_from(found, layout, slow_is_stated=slow)
        return Prepared(
            as_stated(taken), noise, (result_of(*part, noise.contacts if adapt else None) for part in results)
        )
    (log,) = parts(length)
    log = without_useless(log, params)
    samples = samples_of(params, log)
    params = params._replace(joint=no_less_than_shown(params.joint, samples)) if adapt else params
    layout = layout_of(samples.dt)

    def run(method: tuple[str, ...]) -> Run:
        return Run(params, samples, options, method, layout)

    last = ("smooth_bias",) if smooth and adapt else ()
    taken, states, infos = yield run((*method, *last))
    if infos.noise is None:
        noise = nothing()
    else:
        noise = log_noise_from(infos.noise, layout, slow_is_stated=slow)
        if max(infos.kept_out, infos.kept_out_at_first) > 1 - LEAST_USED:
            again = yield run((*method[:-1], "begin_at_median", "filter_bias", *last))
            if better := again[2].kept_out < infos.kept_out:
                taken, states, infos = again
            kept_out = float(infos.kept_out) if infos.kept_out > 1 - LEAST_USED else 0.0
            noise = noise._replace(begun_again=bool(better), kept_out=kept_out)
    if smooth and not adapt:  # smoothed joints have no lag, so their process noise is not guarded
        _, smoothed, _ = yield run((*first, "smooth_joints", "filter_bias", "smooth_bias"))
        states = states._replace(bias_smooth=smoothed.bias_smooth, bias_smooth_std=smoothed.bias_smooth_std)
    noise = noise._replace(contacts=in_log_time(noise.contacts, samples.dt, log.t))
    return Prepared(as_stated(taken), noise, [result_of(log, states, infos, noise.contacts if adapt else None)])


@lru_cache(maxsize=2)
def _params_of(setup: Setup, wide: bool) -> Params:
    """Parameters of a setup, in float64 if ``wide``: computed once for all its logs."""
    return params_from_setup(setup)


def as_stated(params: Params) -> Params:
    """Parameters as JAX arrays, without noise that is zero."""
    return jax.tree.map(jnp.asarray, params._replace(bias=drop_zero_terms(params.bias)))


def in_log_time(contacts: Sequence[Contact], dt: Array, t: Array) -> tuple[Contact, ...]:
    """Contacts in the stamps t (T,) s of the log, instead of in sums of dt, in which a long pause is shortened."""
    passed = np.cumsum(dt[: len(t)])
    late = np.interp([(contact.start, contact.end) for contact in contacts], passed, t - passed) if contacts else []
    return tuple(x._replace(start=x.start + by[0], end=x.end + by[1]) for x, by in zip(contacts, late, strict=True))


def result_of(log: Log, states: States, infos: Infos, contacts: Sequence[Contact] | None) -> Filtered:
    """Result of a log or of a part of one, at the stamps of its wrench, from states that may include padding.

    The contacts are of the whole log; None = it was filtered as on the robot, where they are unknown.
    """
    rows = np.isfinite(log.wrench).any(1)
    at: slice | Array = slice(len(rows)) if rows.all() else np.flatnonzero(rows)
    given = {**states._asdict(), **infos._asdict(), "t": log.t + log.start}
    if states.bias_smooth is not None and states.bias_smooth_std is not None:
        for std, x in (("", states.bias_smooth), ("_std", states.bias_smooth_std)):
            given |= {f"bias_smooth{std}": x[:, 0], f"drift_smooth{std}": x[:, 1]}
    found = {name: given[name][at] for name in ARRAYS if np.ndim(given.get(name, 0))}
    if contacts is None:
        found |= {"used": None, "reading_std": None, "slow_error": None}
    else:
        found["contact_wrench"] = found["wrench_tool"] - found["wrench_unbiased"]
        found["contact_wrench_std"] = np.hypot(found["bias_std"], found["reading_std"])
        found["in_contact"] = in_contact(log.t, contacts)[at]
    return Filtered(**found, log_likelihood=np.float64(infos.log_likelihood))


def filtered_with(setup: Setup, log: Log, calls: int = 1) -> tuple[Filtered, Params]:
    """A log filtered as ``ftbias filter`` does it, in one of ``calls`` calls, and the parameters of the filter."""
    with compiled_for_few_calls(calls * len(log.t)):
        ready = alone(ready_to_filter(setup, slices(log), len(log.t), first_position(log.q)))
        (filtered,) = ready.results
    return filtered, ready.params
