"""Simulators that are consistent with the data: draws from the joint posterior of a diagnosis, within its bounds."""

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
"""Share of the noise below which the rest of the gap is neglected."""
TRIES = 100
"""Maximum number of draws for one sample; if none is within the bounds, the last one is clipped to them."""


class Posterior(NamedTuple):
    """Posterior of the P parameters of all causes, concatenated, and of the effects that may replace each cause."""

    causes: tuple[Candidate, ...]
    names: tuple[str, ...]
    """Names of the P parameters, such as tool_mass.mass or gain.gain[2]."""
    mean: Array
    """(P,) mean of the parameters."""
    covariance: Array
    """(P, P) covariance of the parameters."""
    bounds: Array
    """(2, P) minimum and maximum that the catalogue allows."""
    twins: tuple[tuple[Candidate, ...], ...]
    """Twins of each cause: effects that explain the logs equally well."""
    odds: tuple[Array, ...]
    """Probabilities of each cause and its twins."""


def posterior_of(
    causes: Sequence[Candidate], content: Mapping[str, Any], catalogue: Mapping[str, Effect], file: str = ""
) -> Posterior:
    """Posterior of the causes of a saved diagnosis, whose complete JSON is ``content``.

    The odds are those of the held-out likelihoods over the whole length of the logs.

    Raises:
        LogError: the diagnosis has no joint posterior, or one of other parameters.
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
    """Setup with the rest of the gap, which no drawn simulator reproduces, as correlated noise of its sensor.

    The rest is what no cause explains, and what neither a scene nor a sensor model can express. It has the size of the
    held-out gap, if the saved diagnosis has one, and the time scale of the frequency band that has most of the gap.
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
    """Names of all parameters of the causes."""
    return tuple(
        f"{cause.effect}.{name}" + (f"[{i}]" if np.ndim(value) else "")
        for cause in causes
        for name, value in cause.parameters.items()
        for i in range(np.size(value))
    )


def _flat(causes: Sequence[Candidate], field: str) -> Array:
    """(P,) values or standard errors of the parameters, 0 where there is none."""
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
    """Twins of a cause: effects that explain the logs equally well, as they are in the ranking."""
    found = []
    for name in cause.indistinguishable_from:
        entry = next((x for x in candidates if x.get("effect") == name and x.get("parameters")), None)
        if entry is not None:
            found.append(Candidate(**{key: entry[key] for key in Candidate._fields if key in entry}))
    return found


def _odds(cause: Candidate, twins: Sequence[Candidate], seconds: float) -> Array:
    """Probabilities of a cause and its twins, from equal priors and the held-out nats by which each falls short."""
    behind = np.array([0.0, *(0.0 if x.behind is None else max(x.behind, 0.0) for x in twins)])
    weights = np.exp(-np.nan_to_num(behind) * seconds)
    return weights / weights.sum()


def draw(posterior: Posterior, random: np.random.Generator) -> tuple[Candidate, ...]:
    """Causes with the parameters of one draw; a twin replaces its cause with the probability of its odds."""
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
    """(P,) draw within the bounds: the first of ``TRIES`` draws that is, or else the last one clipped to the bounds."""
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
    """Input of domain randomisation: parameters with mean, covariance and the range of the draws; odds of twins."""
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
