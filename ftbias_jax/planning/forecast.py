"""Forecast of standard errors from the planned motion and from existing logs, and of what stays undetermined."""

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
"""Component, in a unit-norm combination of parameters, above which a parameter is named as part of it."""
LEAST_NATS = 12.5
"""nats; two hypotheses are then distinguished at five standard deviations."""
HOPELESS = LEAST_NATS / 15
"""nats of a plan of usual length below which not even the longest plan distinguishes two effects."""
AS_GOOD = 0.9
"""Share of the standard error at standstill above which a motion's standard error is no reason to move."""
SAME = "change the reading of every motion within the limits in the same way, but for bias and drift"
NOTHING = "changes the reading of no motion within the limits by more than noise, bias and drift do"


class Cannot(NamedTuple):
    """A combination of parameters, or a pair of effects, that the plan does not determine."""

    pair: str
    """The parameters, or effects, that remain indistinguishable."""
    why: str


class Forecast(NamedTuple):
    """Expected standard errors of the P requested parameters."""

    labels: tuple[str, ...]
    units: tuple[str, ...]
    plan: np.ndarray
    """(P,) standard errors from the planned motion; NaN = not determined."""
    logs: np.ndarray | None
    """(P,) standard errors from existing logs; None = there are none."""
    together: np.ndarray | None
    """(P,) standard errors from both."""
    separates: dict[str, float]
    """Two names joined by a colon -> minimum nats by which the plan distinguishes them."""
    cannot: tuple[Cannot, ...]
    """What the plan and the logs together do not determine."""

    @property
    def columns(self) -> dict[str, list[str]]:
        """Standard errors as text, by the motion that they come from."""
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
    """Cramer-Rao bounds of the parameters, with bias and drift as nuisance; for two effects also their separation.

    Args:
        asked: parameters of one name, or of two.
        of_plan: (C, C) products of ``asked.columns``, in standard deviations, over the planned motion.
        of_rest: the same products for standing still for as long.
        of_logs: the same products over the logs; None = there are none.
        effects: catalogue entries of what is asked, except the tool.

    Raises:
        UsageError: no requested parameter is determined, or none better than at standstill, or two effects change every
            motion's reading in the same way.
    """
    both = of_plan if of_logs is None else of_plan + of_logs
    places = [np.arange(len(both))]
    if len(asked) == 2:  # the first one's columns hold the derivatives of the second, hence the reversed order
        places = [rows[1:-6] for rows in reversed(either(len(both), len(asked[1].at)))]
    cannot = [one for a, at in zip(asked, places, strict=True) for one in undetermined(both[np.ix_(at, at)], a)]

    def stds(information: np.ndarray) -> np.ndarray:
        return np.concatenate([stds_of(information[np.ix_(at, at)], a) for a, at in zip(asked, places, strict=True)])

    separates = {}
    if len(asked) == 2:
        name, second = ":".join(a.name for a in asked), len(asked[1].at)
        separates[name] = float(min(separations(of_plan, second)))
        cannot += _twins(name, both, second, effects)
    elif not np.isfinite(stds(both)).any():
        raise UsageError(f"no motion tells: it {NOTHING}", field=asked[0].name, remedy=_extra(effects))
    elif not (stds(of_plan) < AS_GOOD * np.nan_to_num(stds(of_rest), nan=np.inf)).any():
        remedy = "record longer, with the arm at rest"
        raise UsageError(
            "no motion gives smaller standard errors than standing still", field=asked[0].name, remedy=remedy
        )
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


def _twins(name: str, information: np.ndarray, second: int, effects: Sequence[Effect]) -> list[Cannot]:
    """Return two effects that the plan does not separate; raise an error if no motion can separate them."""
    nats = float(min(separations(information, second)))
    if nats < HOPELESS:
        message = f"no motion separates {name.replace(':', ' and ')}, as large as they are taken to be: they {SAME}"
        raise UsageError(message, field="for", remedy=_extra(effects))
    if nats >= LEAST_NATS:
        return []
    why = f"separated by {nats:.1f} nats only, of {LEAST_NATS:g} for five standard deviations: plan for longer"
    return [Cannot(name, why)]


def _extra(effects: Sequence[Effect]) -> str:
    """Measurement that the catalogue recommends to distinguish these effects from one another, or from others."""
    names = {effect.name for effect in effects}
    twins = [twin for effect in effects for twin in effect.twins if len(effects) == 1 or twin.effect in names]
    words = dict.fromkeys(twin.separate_by for twin in twins)
    return "; ".join(words) or "hang a known weight on the tool, or mount the sensor another way round"


def stds_of(information: Float[np.ndarray, "P P"], asked: Asked) -> Float[np.ndarray, " P"]:
    """(P,) standard errors, kg or m of a tool for example; NaN for members of undetermined combinations.

    Undetermined combinations in which a parameter has a small share, such as the size of a direction, do not count.
    """
    values, vectors = np.linalg.eigh(information * asked.scale[:, None] * asked.scale)
    known = values >= asked.poor**-2
    std = np.sqrt((vectors[:, known] ** 2 / values[known]).sum(1))
    open_share = (vectors[:, ~known] ** 2).sum(1)
    return np.where(open_share < MUCH**2, std * asked.scale, np.nan)


def undetermined(information: Float[np.ndarray, "P P"], asked: Asked) -> list[Cannot]:
    """Combinations of parameters, kg or m of a tool, that an information (P, P) leaves open (``Asked.poor``)."""
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
    """(C, C) products of ``asked.columns`` over recorded logs, in standard deviations of the noise of these logs."""
    information = []
    for part in problem.parts:
        made = columns_of_log(part.signals, problem.known, numbers, names=names, catalogue=problem.catalogue)
        white = part.whiten(np.asarray(made)[:, : part.used])
        flat = white.reshape(len(white), -1)
        information.append(flat @ flat.T)
    return np.sum(information, axis=0)
