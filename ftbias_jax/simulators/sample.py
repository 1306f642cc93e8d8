"""Simulators that the data allow: draws from the joint posterior of what a diagnosis found, within its bounds."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.diagnosis.result import Candidate
from ftbias_jax.errors import LogError
from ftbias_jax.model.effects.types import Effect
from ftbias_jax.setup.types import Setup
from ftbias_jax.simulators.mended import OF_THE_ROBOT, is_drag
from ftbias_jax.simulators.sensor_model import EFFECTS
from ftbias_jax.types import Array

FAINT = 0.1
"""Of the noise: a smaller rest of the gap counts as none."""
TRIES = 100
"""Draws of one sample before what is outside of its bounds is put on them."""


class Posterior(NamedTuple):
    """What is known of P numbers, all causes end to end, and which effects may stand in the place of which cause."""

    causes: tuple[Candidate, ...]
    names: tuple[str, ...]
    """P of them, as tool_mass.mass or gain.gain[2]."""
    mean: Array
    """(P,)."""
    covariance: Array
    """(P, P)."""
    bounds: Array
    """(2, P) least and largest value that the catalogue allows."""
    twins: tuple[tuple[Candidate, ...], ...]
    """For each cause the effects that explain the logs as well."""
    odds: tuple[Array, ...]
    """For each cause the probabilities of itself and its twins."""


def posterior_of(
    causes: Sequence[Candidate], content: Mapping[str, Any], catalogue: Mapping[str, Effect], file: str = ""
) -> Posterior:
    """The posterior of the causes of a saved diagnosis, of which ``content`` is all.

    Its odds are those of the held-out likelihoods, over the whole length of the logs.

    Raises:
        LogError: it has no joint posterior, or of other numbers.
    """
    known = [cause for cause in causes if cause.effect in catalogue]
    size = len(names_of(known))
    stated = content.get("posterior")
    correlation = np.asarray(stated["correlation"] if isinstance(stated, Mapping) else [], float)
    if correlation.size != size**2 or not np.isfinite(correlation).all():
        remedy = "diagnose the logs again: ftbias diagnose LOG --json FOUND.json"
        raise LogError("has no joint posterior of its causes", file=file, field="posterior", remedy=remedy)
    stderr = np.nan_to_num(_flat(known, "stderr"))
    seconds = float((content.get("provenance") or {}).get("duration") or 0.0)
    others = [tuple(_twins(cause, content.get("candidates", ()))) for cause in known]
    return Posterior(
        causes=tuple(known),
        names=names_of(known),
        mean=_flat(known, "parameters"),
        covariance=correlation.reshape(size, size) * np.outer(stderr, stderr),
        bounds=_bounds(known, catalogue),
        twins=tuple(others),
        odds=tuple(_odds(cause, twins, seconds) for cause, twins in zip(known, others, strict=True)),
    )


def with_rest(setup: Setup, content: Mapping[str, Any]) -> Setup:
    """The setup with the rest of the gap, which no drawn simulator has, as correlated noise of its sensor.

    That is what no cause explains, and what neither a scene nor a sensor model can say. It has the size of the held-out
    gap, if the saved diagnosis has one, and varies as fast as the band of frequencies that has most of it.
    """
    if not (gap := content.get("gap")):
        return setup
    before, after, noise = (
        np.asarray(x, float) for x in (gap["before"]["rms"], gap["after"]["rms"], gap["noise_floor"])
    )
    found = (*content.get("causes", ()), *content.get("terms", ()))
    unsaid = sum(
        one["shrink"]
        for one in found
        if one.get("effect") not in (*OF_THE_ROBOT, *EFFECTS) and not is_drag(one.get("section", {}))
    )
    rest = np.sqrt(np.maximum(after**2 - noise**2 + unsaid * (before**2 - noise**2), 0))
    rest = np.where(rest > FAINT * noise, rest, 0)
    if not rest.any():
        return setup
    low, high, _ = max(content["where"]["bands"], key=lambda band: band[2])
    time = (
        np.full(6, 1 / (np.pi * (low + high))) if setup.sensor.correlated_time is None else setup.sensor.correlated_time
    )
    own = 0.0 if setup.sensor.correlated_std is None else setup.sensor.correlated_std
    return replace(setup, sensor=replace(setup.sensor, correlated_std=np.hypot(own, rest), correlated_time=time))


def names_of(causes: Sequence[Candidate]) -> tuple[str, ...]:
    """A name for every number of the causes."""
    return tuple(
        f"{cause.effect}.{name}" + (f"[{i}]" if np.ndim(value) else "")
        for cause in causes
        for name, value in cause.parameters.items()
        for i in range(np.size(value))
    )


def _flat(causes: Sequence[Candidate], field: str) -> Array:
    """(P,) values or standard errors, 0 where there is none."""
    parts = [np.zeros(0)]
    for cause in causes:
        for name, value in cause.parameters.items():
            one = getattr(cause, field).get(name)
            parts.append(np.ravel(np.zeros(np.shape(value)) if one is None else np.asarray(one, float)))
    return np.concatenate(parts)


def _bounds(causes: Sequence[Candidate], catalogue: Mapping[str, Effect]) -> Array:
    ends = [np.zeros((2, 0))]
    for cause in causes:
        for name, value in cause.parameters.items():
            parameter = catalogue[cause.effect].parameter(name)
            pair = (np.ravel(np.broadcast_to(x, np.shape(value))) for x in (parameter.lower, parameter.upper))
            ends.append(np.stack(list(pair)))
    return np.concatenate(ends, 1)


def _twins(cause: Candidate, candidates: Sequence[Mapping[str, Any]]) -> list[Candidate]:
    """What stands in the ranking of the effects that explain the logs as well as a cause."""
    found = []
    for name in cause.indistinguishable_from:
        entry = next((x for x in candidates if x.get("effect") == name and x.get("parameters")), None)
        if entry is not None:
            found.append(Candidate(**{key: entry[key] for key in Candidate._fields if key in entry}))
    return found


def _odds(cause: Candidate, twins: Sequence[Candidate], seconds: float) -> Array:
    """Probabilities of a cause and its twins: equal before the logs, and by the unseen nats that each is behind."""
    behind = np.array([0.0, *(0.0 if x.behind is None else max(x.behind, 0.0) for x in twins)])
    weights = np.exp(-np.nan_to_num(behind) * seconds)
    return weights / weights.sum()


def draw(posterior: Posterior, random: np.random.Generator) -> tuple[Candidate, ...]:
    """The causes with numbers of one draw; a twin stands in the place of a cause as often as its odds say."""
    numbers = _within(posterior.mean, posterior.covariance, posterior.bounds, random)
    drawn, place = list[Candidate](), 0
    for cause, twins, odds in zip(posterior.causes, posterior.twins, posterior.odds, strict=True):
        size = sum(np.size(value) for value in cause.parameters.values())
        own, place = numbers[place : place + size], place + size
        chosen = int(random.choice(len(odds), p=odds))
        if chosen:
            cause = twins[chosen - 1]
            mean, stderr = _flat([cause], "parameters"), np.nan_to_num(_flat([cause], "stderr"))
            own = mean + stderr * random.normal(size=len(mean))
        drawn.append(_with_numbers(cause, own))
    return tuple(drawn)


def _within(mean: Array, covariance: Array, bounds: Array, random: np.random.Generator) -> Array:
    """(P,) a draw inside of the bounds: of a few tries, or its nearest point to the last."""
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0))
    for _ in range(TRIES):
        drawn = mean + root @ random.normal(size=len(mean))
        if ((drawn >= bounds[0]) & (drawn <= bounds[1])).all():
            break
    return np.clip(drawn, *bounds)


def _with_numbers(cause: Candidate, numbers: Array) -> Candidate:
    parameters, place = {}, 0
    for name, value in cause.parameters.items():
        size = np.size(value)
        parameters[name] = numbers[place : place + size].reshape(np.shape(value)).tolist()
        place += size
    return cause._replace(parameters=parameters)


def ranges(posterior: Posterior, draws: Sequence[Sequence[Candidate]]) -> dict[str, Any]:
    """What domain randomisation reads: numbers with mean, covariance, and the range of the draws; odds of twins."""
    own = np.array([_flat(one, "parameters") for one in draws if names_of(one) == posterior.names])
    own = own.reshape(-1, len(posterior.mean))
    low, high = np.quantile(own, (0.025, 0.975), axis=0) if len(own) else (posterior.mean, posterior.mean)
    return {
        "parameters": list(posterior.names),
        "mean": posterior.mean.tolist(),
        "covariance": posterior.covariance.tolist(),
        "low": low.tolist(),
        "high": high.tolist(),
        "mixture": [
            {"cause": one.effect, "in_place_of": cause.effect, "odds": float(odds)}
            for cause, twins, weights in zip(posterior.causes, posterior.twins, posterior.odds, strict=True)
            for one, odds in zip((cause, *twins), weights, strict=True)
        ],
    }
