"""What a motion will tell, what the logs at hand tell already, and what nothing does."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.errors import UsageError
from ftbias_jax.model.effects.catalogue import Catalogue
from ftbias_jax.model.effects.types import Effect, Signals, Values
from ftbias_jax.planning.asked import Asked, columns
from ftbias_jax.planning.climb import either, separations
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.types import Array

MUCH = 0.3
"""Part of a mixture, a unit vector, from which on a parameter is named as a part of it."""
LEAST_NATS = 12.5
"""Two hypotheses are told apart at five standard deviations."""
HOPELESS = LEAST_NATS / 15
"""nats of a plan of usual length: with less, not even the longest one tells two effects apart."""
AS_GOOD = 0.9
"""A standard error that is this share of that of standing still or more is no reason to move."""
SAME = "change the reading of every motion within the limits in the same way, but for bias and drift"
NOTHING = "changes the reading of no motion within the limits by more than noise, bias and drift do"


class Cannot(NamedTuple):
    """Something that the plan does not determine."""

    pair: str
    """The parameters, or effects, that stay mixed up."""
    why: str


class Forecast(NamedTuple):
    """What to expect. P = all parameters that are asked for."""

    labels: tuple[str, ...]
    units: tuple[str, ...]
    plan: np.ndarray
    """(P,) standard errors from the planned motion; NaN = not determined."""
    logs: np.ndarray | None
    """(P,) from the logs at hand; None = there are none."""
    together: np.ndarray | None
    """(P,) from both."""
    separates: dict[str, float]
    """Two names with a colon between them -> nats by which the plan tells the one from the other, at the least."""
    cannot: tuple[Cannot, ...]
    """What even both together do not determine."""

    @property
    def columns(self) -> dict[str, list[str]]:
        """Standard errors in words, by the motion that they are from."""
        stds = {"this motion": self.plan, "logs at hand": self.logs, "both": self.together}
        return {
            name: [f"{x:.2g}" if np.isfinite(x) else "not determined" for x in column]
            for name, column in stds.items()
            if column is not None
        }


def forecast(
    asked: Sequence[Asked],
    of_plan: np.ndarray,
    of_rest: np.ndarray,
    of_logs: np.ndarray | None,
    effects: Sequence[Effect],
) -> Forecast:
    """Cramer-Rao bounds of the parameters, with bias and drift as nuisance; of two effects also what separates them.

    Args:
        asked: one or two.
        of_plan: (C, C) products of ``asked.columns``, in standard deviations, over the planned motion.
        of_rest: the same of standing still for as long.
        of_logs: the same over the logs; None = there are none.
        effects: entries of what is asked, but for the tool.

    Raises:
        UsageError: nothing of what is asked is determined, or no better than by standing still, or two effects do the
            same to every motion.
    """
    both = of_plan if of_logs is None else of_plan + of_logs
    places = [np.arange(len(both))]
    if len(asked) == 2:  # the derivatives by the second's numbers come first, beside what the first has beyond it
        places = [rows[1:-6] for rows in reversed(either(len(both), len(asked[1].at)))]
    cannot = [one for a, at in zip(asked, places, strict=True) for one in undetermined(both[np.ix_(at, at)], a)]

    def stds(told: np.ndarray) -> np.ndarray:
        return np.concatenate([stds_of(told[np.ix_(at, at)], a) for a, at in zip(asked, places, strict=True)])

    separates = {}
    if len(asked) == 2:
        name, second = ":".join(a.name for a in asked), len(asked[1].at)
        separates[name] = float(min(separations(of_plan, second)))
        cannot += _twins(name, both, second, effects)
    elif not np.isfinite(stds(both)).any():
        raise UsageError(f"no motion tells: it {NOTHING}", field=asked[0].name, remedy=_extra(effects))
    elif not (stds(of_plan) < AS_GOOD * np.nan_to_num(stds(of_rest), nan=np.inf)).any():
        remedy = "record longer, with the arm at rest"
        raise UsageError("no motion tells more than standing still does", field=asked[0].name, remedy=remedy)
    several = len(asked) > 1
    return Forecast(
        tuple(f"{a.name}.{label}" if several else label for a in asked for label in a.labels),
        tuple(unit for a in asked for unit in a.units),
        stds(of_plan),
        None if of_logs is None else stds(of_logs),
        None if of_logs is None else stds(both),
        separates,
        tuple(cannot),
    )


def _twins(name: str, told: np.ndarray, second: int, effects: Sequence[Effect]) -> list[Cannot]:
    """Whether two effects stay twins; if they do the same to every motion, nothing is planned."""
    nats = float(min(separations(told, second)))
    if nats < HOPELESS:
        message = f"no motion separates {name.replace(':', ' and ')}, as large as they are taken to be: they {SAME}"
        raise UsageError(message, field="for", remedy=_extra(effects))
    if nats >= LEAST_NATS:
        return []
    why = f"separated by {nats:.1f} nats only, of {LEAST_NATS:g} for five standard deviations: plan for longer"
    return [Cannot(name, why)]


def _extra(effects: Sequence[Effect]) -> str:
    """The measurement that the entries name for telling these effects from one another, or from others."""
    names = {effect.name for effect in effects}
    twins = [twin for effect in effects for twin in effect.twins if len(effects) == 1 or twin.effect in names]
    words = dict.fromkeys(twin.separate_by for twin in twins)
    return "; ".join(words) or "hang a known weight on the tool, or mount the sensor another way round"


def stds_of(information: Float[np.ndarray, "P P"], asked: Asked) -> Float[np.ndarray, " P"]:
    """(P,) standard errors, kg or m of a tool, say; NaN of parameters that mixtures which are left open consist of.

    What is left open beside a parameter, such as the size of a direction, does not count.
    """
    values, vectors = np.linalg.eigh(information * asked.scale[:, None] * asked.scale)
    known = values >= asked.poor**-2
    std = np.sqrt((vectors[:, known] ** 2 / values[known]).sum(1))
    open_share = (vectors[:, ~known] ** 2).sum(1)
    return np.where(open_share < MUCH**2, std * asked.scale, np.nan)


def undetermined(information: Float[np.ndarray, "P P"], asked: Asked) -> list[Cannot]:
    """The mixtures of parameters, kg or m of a tool, say, that an information (P, P) leaves open (``Asked.poor``)."""
    values, vectors = np.linalg.eigh(information * asked.scale[:, None] * asked.scale)
    found = []
    for vector in vectors.T[values < asked.poor**-2]:
        parts = [label for label, part in zip(asked.labels, np.abs(vector), strict=True) if part > MUCH]
        found.append(Cannot(", ".join(parts), SAME if len(parts) > 1 else NOTHING))
    return found


@keep_program("names", "catalogue")
def columns_of_log(
    signals: Signals, known: Values, numbers: Any, *, names: tuple[str, ...], catalogue: Catalogue
) -> Array:
    """(C, B, 6) N, Nm: ``asked.columns`` of a recorded motion."""
    return columns(signals, known, numbers, names, catalogue)


def information_of_logs(problem: Problem, names: tuple[str, ...], numbers: Any) -> Float[np.ndarray, "C C"]:
    """(C, C) products of ``asked.columns`` in standard deviations of the noise that recorded logs show."""
    told = []
    for part in problem.parts:
        made = columns_of_log(part.signals, problem.known, numbers, names=names, catalogue=problem.catalogue)
        white = part.whiten(np.asarray(made)[:, : part.used])
        flat = white.reshape(len(white), -1)
        told.append(flat @ flat.T)
    return np.sum(told, axis=0)
