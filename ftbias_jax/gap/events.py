"""Effects that are linear in series known beforehand: settling, temperature, jumps and contacts."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from ftbias_jax.gap import hypotheses as hyp
from ftbias_jax.gap.evaluate import whitened_series
from ftbias_jax.gap.fit import Fit, projection
from ftbias_jax.gap.gains import gain_of_series
from ftbias_jax.gap.hypotheses import Event, Hypothesis
from ftbias_jax.gap.problem import Problem

Found: TypeAlias = tuple[float, Hypothesis]
"""Gain in nats on top of what is accepted, not penalised, and the hypothesis."""

LEAST_EVENT = 60.0
"""nats of a single contact."""
MOST_CONTACT = 0.35
"""Share of the log: what touches the tool for longer is no event."""
LONGEST_EVENT = 3.0
"""s; nor is what touches it once for longer."""
TRIMS = 3
LEAST_HAT, LEAST_SHARE_OF_HAT = 10.0, 0.002
"""nats, and share of the largest, of a hat function at the end of a contact."""
FINE = 17
"""Values tried at every refinement of a time or a time constant."""


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
        _alike(problem, [h.shapes[0] for h in slow]),
        jumps,
        _alike(problem, [h.shapes[0] for h in jumps]),
        events,
        _alike(problem, pulses),
    )


def _alike(problem: Problem, series: Sequence[np.ndarray]) -> np.ndarray:
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


def slow(problem: Problem, library: Library, accepted: Fit, taken: Collection[str]) -> list[Found]:
    """Warm-up, its time constant refined, and temperature."""
    gain = by_channel(accepted, library.slow_white)
    found = [(float(g), h) for g, h in zip(gain, library.slow, strict=True) if h.effect not in taken]
    warm = max((pair for pair in found if pair[1].effect == "warmup"), key=lambda pair: pair[0], default=None)
    if warm is None:
        return found
    log = int(warm[1].detail[1]) if warm[1].detail[1] >= 0 else None
    tau, ratio = warm[1].detail[0], hyp.TIME_CONSTANTS[1] / hyp.TIME_CONSTANTS[0]

    def make(log_tau: np.ndarray) -> list[Hypothesis]:
        return [hyp.warmup(problem, tau, log) for tau in np.exp(log_tau)]

    others = [pair for pair in found if pair[1].effect != "warmup"]
    return [*others, refine(problem, accepted, make, float(np.log(tau)), float(np.log(ratio)))]


def jump(problem: Problem, library: Library, accepted: Fit, taken: Collection[str]) -> list[Found]:
    """The step of the bias that gains most, its time refined."""
    if "bias_jump" in taken or not library.jumps:
        return []
    best = library.jumps[int(by_channel(accepted, library.jumps_white).argmax())]
    when, log = best.detail

    def make(times: np.ndarray) -> list[Hypothesis]:
        return hyp.jumps(problem, int(log), times)

    step = max(hyp.JUMP_STEP, problem.durations[int(log)] / 400)
    return [refine(problem, accepted, make, when, step)]


def refine(
    problem: Problem, accepted: Fit, make: Callable[[np.ndarray], list[Hypothesis]], at: float, reach: float
) -> Found:
    """The best of ever finer grids around a value that a series depends on.

    Args:
        make: values -> one hypothesis each. at: the best so far. reach: how far from it the best may be.
    """
    for _ in range(2):
        values = at + reach * np.linspace(-1, 1, FINE)
        made = make(values)
        gain = by_channel(accepted, _alike(problem, [h.shapes[0] for h in made]))
        best = int(gain.argmax())
        at, reach = float(values[best]), 2 * reach / (FINE - 1)
    return float(gain[best]), made[best]


def contacts(problem: Problem, library: Library, accepted: Fit, taken: Collection[str]) -> list[Found]:
    """The contacts that stand out, as one hypothesis with wrenches of any shape, and its gain."""
    if "contact" in taken or not library.events:
        return []
    white = library.events_white
    power = np.maximum(np.einsum("cuk,cuk->ck", white, white), 1e-6)
    error, events = accepted.error.astype(np.float32), []
    for _ in range(hyp.MOST_EVENTS):
        along = np.einsum("cuk,uk->ck", white, error)
        gain = (along**2 / power / 2).sum(1)
        best = int(gain.argmax())
        if gain[best] < LEAST_EVENT:
            break
        error = error - (along[best] / power[best]) * white[best]
        events.append(library.events[best])
    if not events:
        return []
    shaped = [_shaped(problem, accepted, merge(events), hats) for hats in hyp.SHAPES]
    return sorted((found for found in shaped if _is_short(problem, found[1])), key=_after_penalty)[-1:]


def _is_short(problem: Problem, contact: Hypothesis) -> bool:
    """Whether the contacts are short, each and together."""
    lengths = np.diff(np.reshape(contact.detail, (-1, 4))[:, 1:3])
    return bool(lengths.max() < LONGEST_EVENT and lengths.sum() < MOST_CONTACT * problem.duration)


def _shaped(problem: Problem, accepted: Fit, events: list[Event], hats: int) -> Found:
    """Contacts of so many hat functions each, their beginnings and ends where the data put them."""
    h, white = _contact(problem, events, hats)
    for _ in range(TRIMS):
        coefficients, _ = projection(white)(accepted.error[None])
        nats = ((coefficients.reshape(-1, 1, 6) * white) ** 2).sum((1, 2)) / 2
        by_event = np.split(nats, np.cumsum(hyp.hats_of(h)))
        trimmed = [trim(event, nats) for event, nats in zip(events, by_event[:-1], strict=True)]
        if trimmed == events:
            break
        events = trimmed
        h, white = _contact(problem, events, hats)
    return gain_of_series(accepted, white), h


def _contact(problem: Problem, events: list[Event], hats: int) -> tuple[Hypothesis, np.ndarray]:
    """Contacts of so many hat functions each, and these whitened (E, U, 6)."""
    h = hyp.contact(problem, events, hats)
    return h, whitened_series(problem, h.shapes)


def trim(event: Event, nats: np.ndarray) -> Event:
    """An event without the hats at its ends that hardly matter, for the nats (H,) of each of its hats."""
    log, start, end = event
    matter = np.flatnonzero(nats > max(LEAST_HAT, LEAST_SHARE_OF_HAT * nats.max()))
    if not len(matter):
        return event
    width = (end - start) / (len(nats) - 1)
    first, last = max(int(matter[0]) - 1, 0), min(int(matter[-1]) + 1, len(nats) - 1)
    return log, start + first * width, start + last * width


def _after_penalty(found: Found) -> float:
    gain, h = found
    return gain - hyp.penalty(h)


def merge(events: Sequence[Event]) -> list[Event]:
    """Overlapping events of a log as one, with room for what the pulses that found them do not cover."""
    merged: list[Event] = []
    for log, start, end in sorted(events):
        margin = 0.1 + 0.6 * (end - start)
        start, end = start - margin, end + margin
        if merged and merged[-1][0] == log and start < merged[-1][2]:
            merged[-1] = (log, merged[-1][1], max(end, merged[-1][2]))
        else:
            merged.append((log, start, end))
    return merged
