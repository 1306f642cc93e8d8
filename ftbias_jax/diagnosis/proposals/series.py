"""Slow series and changes at some time, whitened once per problem; their times and time constants are refined.

A jump belongs to the bias if it is sudden and the new level stays whatever the pose is.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.evidence.estimates import rows_of
from ftbias_jax.diagnosis.hypothesis import Change, Event, Found, Hypothesis, Slow, search_of, searched_by
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.design_matrix import change, channels_first
from ftbias_jax.diagnosis.regression.evaluate import readings, sensor_axes, whitened, whitened_single
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.regression.score_test import gains, prepare_fit
from ftbias_jax.diagnosis.regression.series import pulse, retimed, settlings, steps
from ftbias_jax.diagnosis.thresholds import CLOSE, LEAST_GAIN, LONGEST_JUMP
from ftbias_jax.model.effects.fitting import Settling, Step
from ftbias_jax.model.effects.terms.columns import forces_at, torques

RAMPS = (0.15, 0.3, 0.6, 1.2, 2.4)
"""s, durations of a change that are tried."""
FINE = 17
"""Number of values tried in each refinement of a time or a time constant."""
STEP = 0.25
"""s between candidate times of a change in a short log."""
MOST_STEPS = 400
"""Maximum number of these times: the step is the duration of a long log divided by it."""
PULSES = (0.1, 0.25, 0.6, 1.5)
"""s, durations of the candidate events."""


class Dictionary(NamedTuple):
    """Whitened series of one problem that no fit changes, computed once."""

    series: dict[str, list[Hypothesis]]
    """Effect -> hypotheses of those that settle, or change at some time."""
    white: dict[str, np.ndarray]
    """Effect -> (S, U, 6), these series, whitened, the same in every channel."""
    events: list[Event]
    events_white: np.ndarray
    """(6, E, U) pulses, channels first."""


def make_dictionary(problem: Problem) -> Dictionary:
    """All series that are searched."""
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
    pulses = alike(problem, [pulse(problem, event) for event in events])
    return Dictionary(series, white, events, channels_first(pulses))


def between_steps(duration: float) -> float:
    """s between candidate times of a change in a log of this duration in s."""
    return max(STEP, duration / MOST_STEPS)


def alike(problem: Problem, series: Sequence[np.ndarray]) -> np.ndarray:
    """(C, U, 6) in single precision: whitened series (U,), the same in every channel."""
    return whitened_single(problem, [one[:, None] for one in series])


def by_channel(accepted: Fit, white: np.ndarray) -> np.ndarray:
    """(C,) nats of series (C, U, 6), with a coefficient per channel and the accepted effects held fixed."""
    error = accepted.error.astype(white.dtype)
    along = np.einsum("cuk,uk->ck", white, error)
    power = np.einsum("cuk,cuk->ck", white, white)
    return (along**2 / np.maximum(power, 1e-9) / 2).sum(1)


def best_series(problem: Problem, dictionary: Dictionary, accepted: Fit, taken: Collection[str]) -> Iterator[Found]:
    """Best series of every effect that settles, then of every effect that begins at some time, refined."""
    for search, refined in ((Settling, _with_time_constant), (Step, _with_time)):
        for name in (effect.name for effect in searched_by(problem, taken, search)):
            if name in dictionary.series:
                gain = by_channel(accepted, dictionary.white[name])
                place = int(gain.argmax())
                yield refined(problem, accepted, (float(gain[place]), dictionary.series[name][place]))


def _with_time_constant(problem: Problem, accepted: Fit, found: Found) -> Found:
    """Best time constant near that of a slow series; a series without a lag is unchanged."""
    _, h = found
    assert isinstance(h.detail, Slow)
    effect = problem.catalogue[h.effect]
    times = np.array([time for time in effect.parameter(search_of(effect, Settling).time).starts if time > 0])
    if not h.detail.time_constant or len(times) < 2:
        return found

    def make(log_time: np.ndarray) -> list[Hypothesis]:
        return retimed(problem, h, np.exp(log_time).tolist())

    return refine(problem, accepted, make, float(np.log(h.detail.time_constant)), float(np.diff(np.log(times)).max()))


def _with_time(problem: Problem, accepted: Fit, found: Found) -> Found:
    """Best time near that of a change, which is sudden or linear in time."""
    effect, at = problem.catalogue[found[1].effect], found[1].detail
    assert isinstance(at, Change)

    def make(times: np.ndarray) -> list[Hypothesis]:
        return steps(problem, effect, at.log, times)

    sudden = refine(problem, accepted, make, at.time, between_steps(problem.durations[at.log]))
    assert isinstance(sudden[1].detail, Change)
    middle = sudden[1].detail.time
    ramps = [
        h for ramp in RAMPS for h in steps(problem, effect, at.log, middle + ramp * np.linspace(-0.9, -0.1, 9), ramp)
    ]
    gain = by_channel(accepted, alike(problem, [h.shapes[0] for h in ramps]))
    slower = float(gain.max()), ramps[int(gain.argmax())]
    return slower if slower[0] > sudden[0] + LEAST_GAIN else sudden


def refine(
    problem: Problem, accepted: Fit, make: Callable[[np.ndarray], list[Hypothesis]], at: float, reach: float
) -> Found:
    """Best hypothesis on two successively finer grids of values around the best so far, the first within a reach."""
    for _ in range(2):
        values = at + reach * np.linspace(-1, 1, FINE)
        made = make(values)
        gain = by_channel(accepted, alike(problem, [h.shapes[0] for h in made]))
        best = int(gain.argmax())
        at, reach = float(values[best]), 2 * reach / (FINE - 1)
    return float(gain[best]), made[best]


def doubt(problem: Problem, found: Fit, h: Hypothesis) -> str:
    """Reason why a jump of the bias may be something else."""
    assert isinstance(h.detail, Change)
    if h.detail.ramp > LONGEST_JUMP:
        return f"; or something slower that is not in the catalogue, because it took {h.detail.ramp:.2g} s"
    rest, series = without(found, h)
    prepared_fit = prepare_fit(rest)

    def nats_of(columns: np.ndarray) -> float:
        return gains(prepared_fit, columns).of(list(range(len(columns))))

    level = nats_of(series[0] * np.eye(6)[:, None])
    for words, columns in with_the_pose(problem, found, h.shapes[0]).items():
        if nats_of(whitened(problem, columns)) > CLOSE * level:
            return f"; or {words}: the wrist turns too little after the jump to exclude it"
    return ""


def without(found: Fit, h: Hypothesis) -> tuple[Fit, np.ndarray]:
    """Fit without the series of one hypothesis, all else unchanged, and these series (E, U, 6)."""
    numbers = rows_of(found, h)
    own = slice(numbers.start // 6, numbers.stop // 6)
    alone = found.columns._replace(moving=found.columns.moving[:0], series=found.columns.series[own])
    rest = found.columns._replace(series=np.delete(found.columns.series, own, 0))
    return found._replace(error=found.error - change(alone, found.coefficients[numbers]), columns=rest), alone.series


def with_the_pose(problem: Problem, found: Fit, series: np.ndarray) -> dict[str, np.ndarray]:
    """What may set in like a series (U,) but, unlike a bias, follows the pose: words -> columns (K, U, 6) N, Nm."""
    axes = sensor_axes(problem).transpose(1, 0, 2)  # (3, U, 3), each axis of the base in the sensor's coordinates
    down = np.tensordot(np.asarray(problem.parts[0].signals.model.gravity), axes, 1)
    arms = np.cross(np.eye(3)[:, None], down)
    steady, weight = (forces_at(np, np.zeros(3), vectors) for vectors in (axes, down[None]))
    made = {
        "a force that set in then and keeps its direction in the room": [steady, torques(np, axes)],
        "a load that was taken up or lost then": [weight, torques(np, arms)],
        "gauges whose gain changed then": [readings(problem, found.z[None])[0] * np.eye(6)[:, None]],
    }
    return {words: series[:, None] * np.concatenate(pieces) for words, pieces in made.items()}
