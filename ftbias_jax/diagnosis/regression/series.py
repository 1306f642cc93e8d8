"""Series that are linear in their strength: the change that the effect makes to a reading of zero.

Times and time constants are held fixed, so the series is the same whatever the strength in each channel.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.diagnosis.hypothesis import Change, Event, Hypothesis, Shaped, Slow, search_of
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.coordinates import strengths
from ftbias_jax.model.effects.catalogue import Catalogue, complete
from ftbias_jax.model.effects.fitting import Settling, Step
from ftbias_jax.model.effects.types import Effect, Signals
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.types import Array

LANES = 16
"""Number of series that one call computes."""
BINS_A_TENT = 2.5
"""Bins per tent function, so that each is still observed when a quarter of the bins is held out."""


@keep_program("name", "names", "catalogue")
def _unit_series(signals: Signals, held: Array, *, name: str, names: tuple[str, ...], catalogue: Catalogue) -> Array:
    """(C, B): change of the reading by an effect of unit strength, at each of the values (C, k) of other parameters."""
    effect = catalogue[name]
    (strength,) = strengths(effect)
    nothing = jnp.zeros((signals.t.shape[0], 6), signals.t.dtype)

    def one(values: Array) -> Array:
        unit = {strength.name: jnp.ones(strength.shape)} | dict(zip(names, values, strict=True))
        assert effect.reading is not None
        return effect.reading(complete(effect, unit, signals.model), signals, nothing)[:, 0]

    return jax.vmap(one)(held)


def unit_series(problem: Problem, effect: Effect, **held: np.ndarray | Sequence[float]) -> np.ndarray:
    """(C, U): the series of an effect with unit strength in every channel, for C values of its other parameters."""
    values = np.stack([np.asarray(value, float) for value in held.values()], 1)
    what = {"name": effect.name, "names": tuple(held), "catalogue": problem.catalogue}
    pieces = np.resize(values, (-(-len(values) // LANES), LANES, values.shape[1]))  # the last piece is padded
    parts = []
    for part in problem.parts:
        made = np.concatenate([np.asarray(_unit_series(part.signals, some, **what)) for some in pieces])
        parts.append(made[: len(values), : part.used])
    return np.concatenate(parts, axis=1)


def settlings(problem: Problem, effect: Effect) -> list[Hypothesis]:
    """One slow series per time constant that the logs resolve, in all logs and, if it may differ there, in each."""
    search = search_of(effect, Settling)
    times = [float(time) for time in effect.parameter(search.time).starts]
    shown = {
        time: [k for k, d in enumerate(problem.durations) if search.shortest * d <= time < search.longest * d]
        for time in times
    }
    times = [time for time in times if shown[time]]
    if not times:
        return []
    series = unit_series(problem, effect, **{search.time: times})
    found: list[Hypothesis] = []
    for time, one in zip(times, series, strict=True):
        logs: list[int | None] = [*shown[time]] if search.by_log else [None]
        everywhere: list[int | None] = [None] if search.by_log and len(logs) > 1 else []
        found += [_slow(problem, effect, one, time, log) for log in everywhere + logs]
    if search.least_range and np.ptp(found[0].shapes[0]) <= search.least_range:
        return []
    return found


def _slow(problem: Problem, effect: Effect, series: np.ndarray, time: float, log: int | None) -> Hypothesis:
    inside = problem.log == log if log is not None else np.ones_like(problem.t)
    return Hypothesis(effect.name, shapes=(series * inside,), detail=Slow(time, log))


def retimed(problem: Problem, h: Hypothesis, times: Sequence[float]) -> list[Hypothesis]:
    """A slow series with other time constants."""
    effect = problem.catalogue[h.effect]
    assert isinstance(h.detail, Slow)
    series = unit_series(problem, effect, **{search_of(effect, Settling).time: times})
    return [_slow(problem, effect, one, float(time), h.detail.log) for one, time in zip(series, times, strict=True)]


def slope_in_time(problem: Problem, h: Hypothesis) -> np.ndarray:
    """(U,) derivative of a slow series with respect to its time constant in s."""
    assert isinstance(h.detail, Slow)
    time = h.detail.time_constant
    step = max(0.01 * time, 1e-3)
    longer, shorter = (one.shapes[0] for one in retimed(problem, h, [time + step, time]))
    return (longer - shorter) / step


def steps(problem: Problem, effect: Effect, log: int, times: np.ndarray, ramp: float = 0.0) -> list[Hypothesis]:
    """One change for each of the start times in one log, with a ramp of ``ramp`` s."""
    search = search_of(effect, Step)
    if not len(times):
        return []
    series = unit_series(problem, effect, **{search.time: times, search.ramp: np.full(len(times), ramp)})
    series = series * (problem.log == log)
    return [
        Hypothesis(effect.name, shapes=(one,), detail=Change(float(when), log, ramp))
        for one, when in zip(series, times, strict=True)
    ]


def pulse(problem: Problem, event: Event) -> np.ndarray:
    """(U,) unit pulse over an event of one log."""
    inside: np.ndarray = (problem.log == event.log) & (problem.t >= event.start) & (problem.t < event.end)
    return inside.astype(float)


def shaped_events(problem: Problem, effect: str, events: Sequence[Event], tents: int) -> Hypothesis:
    """Events of any shape, which may begin and end suddenly: tent basis functions, each with a wrench of its own.

    Each event has at most ``tents`` of them, and BINS_A_TENT bins for each.
    """
    series: list[np.ndarray] = []
    detail: list[Shaped] = []
    bin_seconds = float(np.median(np.diff(problem.t)))
    for event in events:
        most = int((event.end - event.start) / (BINS_A_TENT * bin_seconds)) + 1
        knots = np.linspace(event.start, event.end, max(min(tents, most), 2))
        inside = pulse(problem, event)
        series += [inside * np.clip(1 - np.abs(problem.t - knot) / (knots[1] - knots[0]), 0, None) for knot in knots]
        detail.append(Shaped(event, len(knots)))
    return Hypothesis(effect, shapes=tuple(series), detail=tuple(detail), local=True)


def shaped(h: Hypothesis) -> tuple[Shaped, ...]:
    """The events of a hypothesis, empty if it has none."""
    details = h.detail if isinstance(h.detail, tuple) else ()
    return tuple(one for one in details if isinstance(one, Shaped))
