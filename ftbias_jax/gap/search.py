"""Which effects explain a log: every effect on top of those accepted so far, the best one added while it earns it."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ftbias_jax.gap import hypotheses as hyp
from ftbias_jax.gap import model
from ftbias_jax.gap.contacts import contacts
from ftbias_jax.gap.fit import Fit, added_gain, block_scores, fit
from ftbias_jax.gap.holdout import excess
from ftbias_jax.gap.hypotheses import Hypothesis
from ftbias_jax.gap.problem import Problem

NATS_PER_DEGREE = 4.0
"""Half the logarithm of the number of independent bins: what a free number gains by chance and search."""
LEAST_GAIN = 12.0
"""nats beyond the penalty; white noise reaches it in one log of thousands."""
LEAST_SIGMAS = 0.08
"""Of one sample's noise: smaller effects are real, perhaps, but mean nothing to the owner."""
WORTH_FITTING = 0.15
"""Share of the best preliminary gain from which on a candidate is fitted in full."""
MOST_LEAKS = 5
"""Entries of the crosstalk matrix that may be named."""
MOST_CAUSES = 3


class Scored(NamedTuple):
    """A hypothesis fitted together with the accepted ones."""

    fit: Fit
    gain: float
    """nats over the accepted ones alone, after the penalty."""

    @property
    def hypothesis(self) -> Hypothesis:
        """The one that was added."""
        return self.fit.hypotheses[-1]


def search(problem: Problem, start: Fit, without: Collection[str] = ()) -> tuple[Fit, list[list[Scored]]]:
    """Add the best effect while it explains enough.

    Args:
        problem: of the log. start: the believed model. without: effects that may not be named.

    Returns:
        the fit of all accepted effects, and for every round all candidates, best first.
    """
    accepted, rounds = start, []
    first_excess = float(excess(problem, start.error).mean())
    for _ in range(MOST_CAUSES):
        scored = candidates(problem, accepted, without)
        rounds.append(scored)
        if not scored or not _earned(problem, accepted, scored[0], first_excess):
            break
        accepted = scored[0].fit
    return accepted, rounds


def _earned(problem: Problem, accepted: Fit, best: Scored, first_excess: float) -> bool:
    removed = float(excess(problem, accepted.error).mean() - excess(problem, best.fit.error).mean())
    needed = max(LEAST_SIGMAS**2, 0.02 * first_excess if accepted.hypotheses else 0.0)
    steady = (
        _z_of_gain(problem, best.fit, accepted) > 2 or best.hypothesis.local or best.hypothesis.effect == "bias_jump"
    )
    return best.gain > LEAST_GAIN and removed > needed and steady


def _z_of_gain(problem: Problem, better: Fit, worse: Fit) -> float:
    difference = block_scores(problem, better) - block_scores(problem, worse)
    return float(difference.sum() / max(np.sqrt(len(difference)) * difference.std(), 1e-12))


def candidates(problem: Problem, accepted: Fit, without: Collection[str] = ()) -> list[Scored]:
    """Every effect that is not accepted yet, fitted on top of the accepted ones; best first."""
    taken = {h.effect for h in accepted.hypotheses} | set(without) | set(problem.known)
    preliminary = [(gain, h) for gain, h in _preliminary(problem, accepted, taken) if gain > 0]
    best: dict[tuple[str, float], tuple[float, Hypothesis]] = {}
    for gain, h in preliminary:
        key = (h.effect, h.detail[0] if h.effect == "encoder_offset" else 0.0)
        if key not in best or gain > best[key][0]:
            best[key] = (gain, h)
    if not best:
        return []
    top = max(gain for gain, _ in best.values())
    scored = []
    for gain, h in best.values():
        if gain < WORTH_FITTING * top or gain < LEAST_GAIN:
            continue
        found = fit(problem, (*accepted.hypotheses, h), accepted)
        degrees = found.degrees - accepted.degrees
        scored.append(Scored(found, found.log_likelihood - accepted.log_likelihood - NATS_PER_DEGREE * degrees))
    return sorted(scored, key=lambda s: -s.gain)


def _preliminary(problem: Problem, accepted: Fit, taken: Collection[str]) -> list[tuple[float, Hypothesis]]:
    """Penalised gains of all hypotheses to first order, or at their starting points."""
    found = _smooth(problem, accepted, taken)
    found += [pair for make in (_grid, _slow, _jump, contacts) for pair in make(problem, accepted, taken)]
    return [(gain - NATS_PER_DEGREE * (len(h.free) + 6 * len(h.shapes)), h) for gain, h in found]


def _smooth(problem: Problem, accepted: Fit, taken: Collection[str]) -> list[tuple[float, Hypothesis]]:
    n = problem.signals.q.shape[1]
    wanted = [h for h in hyp.smooth_hypotheses(n) if h.effect not in taken]
    places = sorted({i for h in wanted for i in h.free} | set(model.coordinates(n, "crosstalk").tolist()))
    directions = np.zeros((96, model.size(n)))
    directions[np.arange(len(places)), places] = 1
    nothing = jnp.zeros((0, len(problem.samples), 6))
    at, link = jnp.asarray(accepted.z), jnp.asarray(accepted.link)
    _, columns, _ = model.linearise(
        problem.signals, problem.wrench, problem.known, at, link, jnp.asarray(directions), nothing
    )
    column = dict(zip(places, np.asarray(columns), strict=False))
    found = [(added_gain(accepted, np.stack([column[i] for i in h.free])), h) for h in wanted]
    if "crosstalk" not in taken:
        leaks = {int(i): column[int(i)] for i in model.coordinates(n, "crosstalk")}
        found.append(_leaks(accepted, leaks))
    return found


def _leaks(accepted: Fit, leaks: dict[int, np.ndarray]) -> tuple[float, Hypothesis]:
    """Matching pursuit: the few entries of the matrix that gain most together."""
    chosen: list[int] = []
    gained = 0.0
    for _ in range(MOST_LEAKS):
        trials = {i: added_gain(accepted, np.stack([leaks[j] for j in [*chosen, i]])) for i in leaks if i not in chosen}
        best = max(trials, key=lambda i: trials[i])
        if trials[best] - gained < max(2 * NATS_PER_DEGREE, 0.03 * trials[best]):
            break
        chosen, gained = [*chosen, best], trials[best]
    return gained, Hypothesis("crosstalk", tuple(chosen), (0.0,) * len(chosen))


def _grid(problem: Problem, accepted: Fit, taken: Collection[str]) -> list[tuple[float, Hypothesis]]:
    """Gain of each starting point, as it is or scaled to fit."""
    signals = problem.signals
    now = np.asarray(
        model.predict_many(signals, problem.known, jnp.asarray(accepted.z)[None], jnp.asarray([accepted.link]))
    )[0]
    span = np.ptp(now[: problem.used], axis=0)
    wanted = [h for h in hyp.grid_hypotheses(problem, span) if h.effect not in taken]
    if not wanted:
        return []
    z = np.repeat(accepted.z[None], len(wanted), 0)
    for row, h in zip(z, wanted, strict=True):
        row[list(h.free)] = h.start
    link = np.array([h.link if h.effect == "cable" else accepted.link for h in wanted])
    changes = []
    for part in range(0, len(wanted), 16):
        rows = np.resize(z[part : part + 16], (16, z.shape[1]))
        predicted = model.predict_many(
            signals, problem.known, jnp.asarray(rows), jnp.asarray(np.resize(link[part : part + 16], 16))
        )
        changes.append(np.asarray(model.whiten_many(problem.wrench, predicted - now[None])))
    found = []
    for h, change in zip(wanted, np.concatenate(changes), strict=False):
        if h.effect == "cable":
            found.append((added_gain(accepted, change[None]), h))
        elif h.effect == "hysteresis":
            found.append((added_gain(accepted, change[None] * np.eye(6)[:, None]), h))
        else:
            found.append((float(-(accepted.error * change).sum() - (change**2).sum() / 2), h))
            found.append((added_gain(accepted, change[None]) / 2, h))
    return found


def _by_channel(problem: Problem, accepted: Fit, wanted: list[Hypothesis]) -> list[tuple[float, Hypothesis]]:
    """Gain of hypotheses with one series each, a coefficient a channel."""
    if not wanted:
        return []
    found = []
    for part in range(0, len(wanted), 64):
        some = wanted[part : part + 64]
        series = np.stack([h.shapes[0] for h in some] + [some[0].shapes[0]] * (64 - len(some)))
        columns = np.repeat(series[:, :, None], 6, 2)
        white = np.asarray(model.whiten_many(problem.wrench, jnp.asarray(columns)))[: len(some)]
        power = (white**2).sum(1)
        along = (white * accepted.error).sum(1)
        gains = (along**2 / np.maximum(power, 1e-9) / 2).sum(1)
        found += list(zip(gains.tolist(), some, strict=True))
    return found


def _slow(problem: Problem, accepted: Fit, taken: Collection[str]) -> list[tuple[float, Hypothesis]]:
    t = np.asarray(problem.signals.t)
    wanted = hyp.warmups(t, problem.duration) + hyp.temperatures(np.asarray(problem.signals.temperature))
    return _by_channel(problem, accepted, [h for h in wanted if h.effect not in taken])


def _jump(problem: Problem, accepted: Fit, taken: Collection[str]) -> list[tuple[float, Hypothesis]]:
    if "bias_jump" in taken:
        return []
    t = np.asarray(problem.signals.t)
    coarse = np.arange(1.0, problem.duration - 1.0, max(hyp.JUMP_STEP, problem.duration / 400))
    best = max(_by_channel(problem, accepted, hyp.jumps(t, coarse)), default=None, key=lambda pair: pair[0])
    if best is None:
        return []
    fine = best[1].detail[0] + np.linspace(-hyp.JUMP_STEP, hyp.JUMP_STEP, 51)
    gain, h = max(_by_channel(problem, accepted, hyp.jumps(t, fine)), key=lambda pair: pair[0])
    return [(gain, h)]
