"""Finding contacts: a matched filter for pulses, event by event."""

from __future__ import annotations

from collections.abc import Collection

import jax.numpy as jnp
import numpy as np

from ftbias_jax.gap import hypotheses as hyp
from ftbias_jax.gap import model
from ftbias_jax.gap.fit import Fit, added_gain
from ftbias_jax.gap.hypotheses import Hypothesis
from ftbias_jax.gap.problem import Problem

LEAST_EVENT = 60.0
"""nats of a single event."""
MOST_CONTACT = 0.35
"""Share of the log: what touches the tool for longer is no event."""


def contacts(problem: Problem, accepted: Fit, taken: Collection[str]) -> list[tuple[float, Hypothesis]]:
    """The events that stand out, as one hypothesis with wrenches of any shape, and its gain in nats."""
    if "contact" in taken:
        return []
    t = np.asarray(problem.signals.t)
    windows = [
        (start, start + length)
        for length in hyp.PULSES
        for start in np.arange(0.3, problem.duration - length, max(length / 2, problem.duration / 400))
    ]
    pulses = [Hypothesis("contact", shapes=(hyp.pulse(t, *window),), detail=window, local=True) for window in windows]
    whites = []
    for part in range(0, len(pulses), 64):
        series = np.stack([h.shapes[0] for h in pulses[part : part + 64]])
        series = np.concatenate([series, np.zeros((64 - len(series), len(t)))])
        columns = jnp.asarray(np.repeat(series[:, :, None], 6, 2))
        whites.append(np.asarray(model.whiten_many(problem.wrench, columns), np.float32)[: len(pulses) - part])
    white = np.concatenate(whites)
    power = np.maximum((white**2).sum(1), 1e-6)
    error, events = accepted.error.astype(np.float32).copy(), []
    for _ in range(hyp.MOST_EVENTS):
        along = np.einsum("pbc,bc->pc", white, error)
        gains = (along**2 / power / 2).sum(1)
        best = int(gains.argmax())
        if gains[best] < LEAST_EVENT:
            break
        error = error - (along[best] / power[best]) * white[best]
        events.append(windows[best])
    merged = merge(events)
    if not merged or sum(end - start for start, end in merged) > MOST_CONTACT * problem.duration:
        return []
    h = hyp.contact(t, merged)
    shapes = model.whiten_many(problem.wrench, jnp.asarray(hyp.spread(h.shapes)))
    return [(added_gain(accepted, np.asarray(shapes)), h)]


def merge(events: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Overlapping events as one, a little longer than the pulses that found them."""
    merged: list[tuple[float, float]] = []
    for start, end in sorted(events):
        margin = 0.25 * (end - start)
        start, end = start - margin, end + margin
        if merged and start < merged[-1][1]:
            merged[-1] = (merged[-1][0], max(end, merged[-1][1]))
        else:
            merged.append((start, end))
    return merged
