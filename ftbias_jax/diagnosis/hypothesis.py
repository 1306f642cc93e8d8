"""Hypotheses about a log: one starting point of an effect's fit, or series that are linear in their coefficients."""

from collections.abc import Collection
from typing import NamedTuple, TypeAlias, TypeVar

import jax
import numpy as np

from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.coordinates import can_move, is_moment, to_coordinates
from ftbias_jax.diagnosis.thresholds import PENALTY_PER_PARAMETER, PRIOR_STD
from ftbias_jax.model.effects.fitting import SUDDEN, Starts
from ftbias_jax.model.effects.types import Effect

S = TypeVar("S")


class Slow(NamedTuple):
    """Series with a time constant."""

    time_constant: float
    """s."""
    log: int | None
    """Number of the log that contains it; None = all logs."""


class Change(NamedTuple):
    """Series that begins at some time in one log."""

    time: float
    """s since the start of the log."""
    log: int
    ramp: float
    """s; duration of the change."""


class Event(NamedTuple):
    """Interval of an event in one log."""

    log: int
    start: float
    """s since the start of the log."""
    end: float


class Shaped(NamedTuple):
    """Event of any shape, made up of a number of series from its start to its end."""

    event: Event
    series: int


Detail: TypeAlias = int | Slow | Change | tuple[Shaped, ...] | None
"""Number of the joint, from 1, that an offset belongs to, or what the series represent."""


class Hypothesis(NamedTuple):
    """One effect at one starting point. E = series that are linear in their coefficients."""

    effect: str
    free: tuple[int, ...] = ()
    """Indices in ``Problem.layout`` of the coordinates that are fitted."""
    start: tuple[float, ...] = ()
    """Starting values of the free coordinates."""
    fixed: tuple[tuple[int, float], ...] = ()
    """Further coordinates with the values at which they are held."""
    shapes: tuple[np.ndarray, ...] = ()
    """(U,) series, each with a coefficient for every channel: changes of the reading."""
    detail: Detail = None
    """Joint of an offset, or what the series represent."""
    local: bool = False
    """Whether it acts for a short time only."""
    prior_std: float = PRIOR_STD
    """Typical departures; prior standard deviation of the coordinates."""
    group: int = 0
    """Group of this starting point; the best one of every group of an effect is fitted."""

    def begin(self, z: np.ndarray) -> np.ndarray:
        """Coordinates (P,) with those of this hypothesis set to its start."""
        z = z.copy()
        z[list(self.free)] = self.start
        for place, value in self.fixed:
            z[place] = value
        return z


Found: TypeAlias = tuple[float, Hypothesis]
"""Gain in nats over the accepted fit, before the penalty, and the hypothesis."""


def searched_by(problem: Problem, taken: Collection[str], *searches: type) -> list[Effect]:
    """Effects of the catalogue with one of these searches, except those already taken."""
    return [effect for effect in problem.catalogue.searched_by(*searches) if effect.name not in taken]


def search_of(effect: Effect, search: type[S]) -> S:
    """Search of an effect, asserted to be of that kind."""
    assert isinstance(effect.fit.search, search)
    return effect.fit.search


def moments(problem: Problem, effect: Effect) -> tuple[str, ...]:
    """Parameters that are times within the longest log, of an effect without a search of its own."""
    if not isinstance(effect.fit.search, Starts):
        return ()
    return tuple(p.name for p in effect.parameters if is_moment(p, max(problem.durations)))


def is_sudden(problem: Problem, effect: Effect) -> bool:
    """Whether an effect begins, or lasts, at some time: its gain may come from few blocks of a log."""
    return isinstance(effect.fit.search, SUDDEN) or bool(moments(problem, effect))


def penalty(h: Hypothesis) -> float:
    """nats that a hypothesis must gain to be worth its free parameters."""
    return PENALTY_PER_PARAMETER * (len(h.free) + 6 * len(h.shapes))


def at_zero(effect: str, free: np.ndarray | list[int]) -> Hypothesis:
    """Hypothesis of an effect that starts at neutral, with these coordinates free."""
    return Hypothesis(effect, tuple(int(i) for i in free), (0.0,) * len(free))


def movable(problem: Problem, effect: Effect) -> list[int]:
    """Coordinates of an effect that are fitted: those of parameters to which its entry gives a scale."""
    places = problem.layout.slices
    found: list[int] = []
    for parameter in effect.parameters:
        if (effect.name, parameter.name) in places:
            s = places[effect.name, parameter.name]
            found += (s.start + np.flatnonzero(np.broadcast_to(can_move(parameter), s.stop - s.start))).tolist()
    return found


def places_of(problem: Problem, effect: Effect, **values: np.ndarray | float) -> dict[int, float]:
    """Coordinates of an effect's parameters at the given values: index -> coordinate."""
    places = problem.layout.slices
    found: dict[int, float] = {}
    for name, value in values.items():
        at = to_coordinates(effect, effect.parameter(name), neutral_of(problem, effect, name), value)
        s = places[effect.name, name]
        found |= dict(zip(range(s.start, s.stop), at.tolist(), strict=True))
    return found


def neutral_of(problem: Problem, effect: Effect, name: str) -> np.ndarray:
    """Neutral value of a parameter, in its shape, for one event. The model is passed as NumPy to compile nothing."""
    parameter, neutral = effect.parameter(name), effect.parameter(name).neutral
    value = neutral(jax.tree.map(np.asarray, problem.parts[0].signals.model)) if callable(neutral) else neutral
    return np.broadcast_to(np.asarray(value, float), np.abs(parameter.shape).astype(int))


def at_values(problem: Problem, effect: Effect, **values: np.ndarray | float) -> Hypothesis:
    """Hypothesis of an effect that starts at these parameter values, free where the entry gives them a scale."""
    places, able = places_of(problem, effect, **values), movable(problem, effect)
    start = {place: value for place, value in places.items() if place in able}
    held = tuple((place, value) for place, value in places.items() if place not in able)
    return Hypothesis(effect.name, tuple(start), tuple(start.values()), held)
