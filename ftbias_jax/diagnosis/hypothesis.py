"""What each effect of the catalogue could be on this log: starting points for the fits.

Effects that are smooth start at zero. Times, time constants and places are searched on a grid first, because the
likelihood has several maxima in them; series that are linear in their coefficients need no fit at all.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression import chain_model
from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.types import Signals

DELAYS = (0.0, 0.05, 0.12, 0.25, 0.45)
LAGS = (0.008, 0.02, 0.04, 0.08, 0.16, 0.32)
LOOP_SHARES = (0.01, 0.03, 0.08, 0.2)
TIME_CONSTANTS = tuple(np.geomspace(0.5, 512.0, 21))
JUMP_STEP = 0.25
PULSES = (0.1, 0.25, 0.6, 1.5)
"""s, lengths of the contacts that are looked for."""
MOST_EVENTS = 8
LEAST_WARMING = 0.3
"""K."""
SHAPES = (4, 8, 16, 32)
"""Hat functions that may make up a contact of any shape."""
BINS_A_HAT = 2.5
"""So that every hat function is seen when a fourth of the bins is left out."""


NATS_PER_DEGREE = 4.0
"""Half the logarithm of the number of independent bins: what a free number gains by chance and search."""

Event: TypeAlias = tuple[int, float, float]
"""Number of the log, start s, end s."""


class Hypothesis(NamedTuple):
    """One effect at one starting point. E = series that are linear in coefficients."""

    effect: str
    free: tuple[int, ...] = ()
    """Coordinates of model.blocks that are fitted."""
    start: tuple[float, ...] = ()
    """Their values."""
    fixed: tuple[tuple[int, float], ...] = ()
    """Further coordinates and the values that they keep."""
    link: float = 0.0
    """Link of the cable's anchor."""
    shapes: tuple[np.ndarray, ...] = ()
    """(U,) series, each with a coefficient for every channel: changes of the reading."""
    detail: tuple[float, ...] = ()
    """What the series stand for: the joint; a time constant and the log, -1 = all; time, log and length of a jump; of
    every contact (log, start, end, number of series)."""
    local: bool = False
    """Whether it acts for a short time only."""
    each: bool = False
    """Whether every starting point of its effect that is proposed is fitted, and not only the best one."""


def penalty(h: Hypothesis) -> float:
    """nats that a hypothesis must gain to be worth its free numbers."""
    return NATS_PER_DEGREE * (len(h.free) + 6 * len(h.shapes))


SMOOTH = (
    "tool_mass",
    "tool_com",
    "tool_inertia",
    "gravity_tilt",
    "gain",
    "mount_rotation",
    "encoder_offset",
    "crosstalk",
)
"""Effects that the derivative at zero strength tells all about."""


def smooth_hypotheses(n: int) -> list[Hypothesis]:
    """What one linearisation finds; each encoder is a hypothesis of its own, and so is a tool that turns too."""
    found = [_at_zero(name, chain_model.coordinates(n, name)) for name in SMOOTH[:5]]
    axes, tool = (np.r_[chain_model.slices(n)["mount_rotation", name]] for name in ("rotation", "tool_turns"))
    found.append(_at_zero("mount_rotation", axes))
    found.append(found[-1]._replace(fixed=((int(tool[0]), 1.0),)))
    for joint, place in enumerate(chain_model.coordinates(n, "encoder_offset"), 1):
        found.append(_at_zero("encoder_offset", [place])._replace(detail=(float(joint),)))
    return found


def _at_zero(effect: str, free: np.ndarray | list[int]) -> Hypothesis:
    return Hypothesis(effect, tuple(int(i) for i in free), (0.0,) * len(free))


def grid_hypotheses(problem: Problem, span: np.ndarray) -> list[Hypothesis]:
    """Starting points of the effects that need a search.

    Args:
        problem: of the log.
        span: (6,) N, Nm, range of the predicted load.
    """
    found = [at_values(problem, "time_delay", ("delay", delay)) for delay in DELAYS]
    found += [at_values(problem, "low_pass", ("lag", lag)) for lag in LAGS]
    return found + [at_values(problem, "hysteresis", ("width", share * span)) for share in LOOP_SHARES]


def at_values(problem: Problem, effect: str, *values: tuple[str, np.ndarray | float], link: float = 0.0) -> Hypothesis:
    """An effect that starts at these values of its parameters, as differences from neutral."""
    places = chain_model.slices(problem.joints)
    unit = {(b.effect, b.parameter): np.asarray(b.unit) for b in chain_model.blocks(problem.joints)}
    free: list[int] = []
    start: list[float] = []
    for parameter, value in values:
        s = places[effect, parameter]
        free += range(s.start, s.stop)
        start += np.broadcast_to(np.asarray(value) / unit[effect, parameter], s.stop - s.start).tolist()
    return Hypothesis(effect, tuple(free), tuple(float(x) for x in start), link=link)


def warmups(problem: Problem) -> list[Hypothesis]:
    """Exponential settling with each time constant that a log can tell from a straight line; in all logs or in one."""
    found = []
    for tau in TIME_CONSTANTS:
        logs = [k for k, duration in enumerate(problem.durations) if 0.02 * duration < tau < 2 * duration]
        found += [warmup(problem, tau)] if len(logs) > 1 else []
        found += [warmup(problem, tau, k) for k in logs]
    return found


def warmup(problem: Problem, tau: float, log: int | None = None) -> Hypothesis:
    """Exponential settling with one time constant, in one log or in all."""
    series = np.expm1(-problem.t / tau)
    inside = problem.log == log if log is not None else np.ones_like(problem.t)
    return Hypothesis("warmup", shapes=(series * inside,), detail=(tau, -1.0 if log is None else float(log)))


def temperatures(problem: Problem) -> list[Hypothesis]:
    """The recorded temperature as the bias, with several lags, if it moved by more than a thermometer's noise."""
    starts = problem.temperature[np.searchsorted(problem.log, np.arange(len(problem.parts)))]
    if np.ptp(problem.temperature - starts[problem.log]) <= LEAST_WARMING:
        return []
    longest = max(problem.durations) / 2
    return [temperature(problem, lag) for lag in (0.0, *(lag for lag in TIME_CONSTANTS if lag < longest))]


def temperature(problem: Problem, lag: float) -> Hypothesis:
    """The recorded temperature, followed with a time constant in s, as the bias."""
    felt = [_felt(part.signals, lag)[: part.used] for part in problem.parts]
    return Hypothesis("temperature_drift", shapes=(-np.concatenate(felt),), detail=(lag, -1.0))


def _felt(signals: Signals, lag: float) -> np.ndarray:
    """(B,) K, since the start of the log."""
    unit = {"temperature_drift": {"per_kelvin": jnp.ones(6), "lag": jnp.asarray(lag)}}
    return np.asarray(_bias_of(signals, unit))[:, 0]


_bias_of = jax.jit(compose.bias)


def retimed(problem: Problem, h: Hypothesis, time_constant: float) -> Hypothesis:
    """A warm-up or a temperature with another time constant."""
    if h.effect == "temperature_drift":
        return temperature(problem, time_constant)
    return warmup(problem, time_constant, int(h.detail[1]) if h.detail[1] >= 0 else None)


def slope_in_time(problem: Problem, h: Hypothesis) -> np.ndarray:
    """(U,) derivative of the series of a warm-up or a temperature by its time constant, s."""
    step = max(0.01 * h.detail[0], 1e-3)
    longer, shorter = (retimed(problem, h, h.detail[0] + sign * step).shapes[0] for sign in (1, 0))
    slope: np.ndarray = (longer - shorter) / step
    return slope


def jumps(problem: Problem, log: int, times: np.ndarray, ramp: float = 0.0) -> list[Hypothesis]:
    """A jump of the bias that begins at each of the times of one log, and takes ``ramp`` s."""
    inside = problem.log == log

    def after(when: float) -> np.ndarray:
        step: np.ndarray = (problem.t >= when).astype(float)
        return np.clip((problem.t - when) / ramp, 0, 1) if ramp else step

    return [Hypothesis("bias_jump", shapes=(-after(when) * inside,), detail=(float(when), log, ramp)) for when in times]


def pulse(problem: Problem, log: int, start: float, end: float) -> np.ndarray:
    """(U,) a flat pulse in one log."""
    inside: np.ndarray = (problem.log == log) & (problem.t >= start) & (problem.t < end)
    return inside.astype(float)


def contact(problem: Problem, events: list[Event], hats: int) -> Hypothesis:
    """Contacts of any shape, which may begin and end suddenly: hat functions, each with a wrench of its own.

    Args:
        problem: of the logs.
        events: when.
        hats: of each contact at most; there are BINS_A_HAT bins for every one.
    """
    series: list[np.ndarray] = []
    detail: tuple[float, ...] = ()
    bin_seconds = float(np.median(np.diff(problem.t)))
    for log, start, end in events:
        most = int((end - start) / (BINS_A_HAT * bin_seconds)) + 1
        knots = np.linspace(start, end, max(min(hats, most), 2))
        inside = pulse(problem, log, start, end)
        series += [inside * np.clip(1 - np.abs(problem.t - knot) / (knots[1] - knots[0]), 0, None) for knot in knots]
        detail += (log, start, end, len(knots))
    return Hypothesis("contact", shapes=tuple(series), detail=detail, local=True)


def hats_of(contact: Hypothesis) -> np.ndarray:
    """(E,) how many series each contact has."""
    return np.reshape(contact.detail, (-1, 4))[:, 3].astype(int)
