"""Whitened series that no fit changes, worked out once for a problem, and what each of them gains."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from ftbias_jax.diagnosis.hypothesis import Event, Hypothesis
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.evaluate import whitened_single
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.regression.series import pulse, settlings, steps
from ftbias_jax.model.effects.fitting import Settling, Step

STEP = 0.25
"""s between the times at which a change is looked for, in a short log."""
MOST_STEPS = 400
"""In a long log its length is divided by this."""
PULSES = (0.1, 0.25, 0.6, 1.5)
"""s, lengths of the events that are looked for."""

Found: TypeAlias = tuple[float, Hypothesis]
"""Gain in nats on top of what is accepted, not penalised, and the hypothesis."""


class Library(NamedTuple):
    """Whitened series of one problem that no fit changes: worked out once."""

    series: dict[str, list[Hypothesis]]
    """Effect -> what it could be: of those that settle, or change at some time."""
    white: dict[str, np.ndarray]
    """Effect -> (S, U, 6), the same series in every channel."""
    events: list[Event]
    events_white: np.ndarray
    """(E, U, 6) pulses."""


def make_library(problem: Problem) -> Library:
    """All series that are searched through."""
    series: dict[str, list[Hypothesis]] = {}
    for effect in problem.catalogue.searched_by(Settling):
        if all(need in problem.recorded for need in effect.needs):
            series[effect.name] = settlings(problem, effect)
    for effect in problem.catalogue.searched_by(Step):
        series[effect.name] = [
            h
            for log, duration in enumerate(problem.durations)
            for h in steps(problem, effect, log, np.arange(1.0, duration - 1.0, between_steps(duration)))
        ]
    events = [
        Event(log, float(start), float(start + length))
        for log, duration in enumerate(problem.durations)
        for length in PULSES
        for start in np.arange(0.3, duration - length, max(length / 2, duration / MOST_STEPS))
    ]
    series = {name: found for name, found in series.items() if found}
    white = {name: alike(problem, [h.shapes[0] for h in found]) for name, found in series.items()}
    return Library(series, white, events, alike(problem, [pulse(problem, event) for event in events]))


def between_steps(duration: float) -> float:
    """s between the times at which a change is looked for in a log of so many seconds."""
    return max(STEP, duration / MOST_STEPS)


def alike(problem: Problem, series: Sequence[np.ndarray]) -> np.ndarray:
    """(C, U, 6) in single precision: whitened series (U,), the same in every channel."""
    return whitened_single(problem, [one[:, None] for one in series])


def by_channel(accepted: Fit, white: np.ndarray) -> np.ndarray:
    """(C,) nats of series (C, U, 6) with a coefficient a channel, beside the accepted effects held where they are."""
    error = accepted.error.astype(white.dtype)
    along = np.einsum("cuk,uk->ck", white, error)
    power = np.einsum("cuk,cuk->ck", white, white)
    gain: np.ndarray = (along**2 / np.maximum(power, 1e-9) / 2).sum(1)
    return gain
