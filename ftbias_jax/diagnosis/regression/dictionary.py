"""Whitened series that no fit changes, worked out once for a problem, and what each of them gains."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from ftbias_jax.diagnosis import hypothesis as hyp
from ftbias_jax.diagnosis.hypothesis import Event, Hypothesis
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.evaluate import whitened_series
from ftbias_jax.diagnosis.regression.fit import Fit

Found: TypeAlias = tuple[float, Hypothesis]
"""Gain in nats on top of what is accepted, not penalised, and the hypothesis."""


class Library(NamedTuple):
    """Whitened series of one problem that no fit changes: worked out once."""

    slow: list[Hypothesis]
    slow_white: np.ndarray
    """(S, U, 6), the same series in every channel."""
    jumps: list[Hypothesis]
    jumps_white: np.ndarray
    events: list[Event]
    events_white: np.ndarray
    """(E, U, 6) pulses."""


def make_library(problem: Problem) -> Library:
    """All series that are searched through."""
    slow = hyp.warmups(problem) + hyp.temperatures(problem)
    jumps, events = [], []
    for log, duration in enumerate(problem.durations):
        step = max(hyp.JUMP_STEP, duration / 400)
        jumps += hyp.jumps(problem, log, np.arange(1.0, duration - 1.0, step))
        events += [
            (log, float(start), float(start + length))
            for length in hyp.PULSES
            for start in np.arange(0.3, duration - length, max(length / 2, duration / 400))
        ]
    pulses = [hyp.pulse(problem, *event) for event in events]
    return Library(
        slow,
        alike(problem, [h.shapes[0] for h in slow]),
        jumps,
        alike(problem, [h.shapes[0] for h in jumps]),
        events,
        alike(problem, pulses),
    )


def alike(problem: Problem, series: Sequence[np.ndarray]) -> np.ndarray:
    """(C, U, 6) in single precision: whitened series, the same in every channel."""
    if not series:
        return np.zeros((0, len(problem.t), 6), np.float32)
    pieces = [series[i : i + 64] for i in range(0, len(series), 64)]
    return np.concatenate([whitened_series(problem, piece).astype(np.float32) for piece in pieces])


def by_channel(accepted: Fit, white: np.ndarray) -> np.ndarray:
    """(C,) nats of series (C, U, 6) with a coefficient a channel, beside the accepted effects held where they are."""
    error = accepted.error.astype(white.dtype)
    along = np.einsum("cuk,uk->ck", white, error)
    power = np.einsum("cuk,cuk->ck", white, white)
    gain: np.ndarray = (along**2 / np.maximum(power, 1e-9) / 2).sum(1)
    return gain
