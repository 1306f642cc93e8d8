"""The diagnosis of one log: examine samples, search causes, judge on held-out blocks, say what is and is not known."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import cast

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.effects.catalogue import CATALOGUE
from ftbias_jax.errors import UsageError
from ftbias_jax.gap import fit as fits
from ftbias_jax.gap.fit import Fit
from ftbias_jax.gap.holdout import HeldOut, excess_by_channel, excess_stderr, hold_out
from ftbias_jax.gap.locate import Motion, locate
from ftbias_jax.gap.model import predict_many
from ftbias_jax.gap.problem import Problem, make_problem
from ftbias_jax.gap.samples_types import Finding
from ftbias_jax.gap.search import Scored, search
from ftbias_jax.gap.sentence import sentence_of
from ftbias_jax.gap.types import Candidate, Diagnosis, Gap, Series
from ftbias_jax.gap.values import Parameters, parameters
from ftbias_jax.screws import sensor_pose
from ftbias_jax.setup_types import Setup
from ftbias_jax.types import Log

SILENT = 0.12
"""Gap in noise sigmas below which nothing is missing: the joints' own error reaches half of it."""
USEFUL_SHARE = 0.5
"""Of the gap; causes that remove less explain nothing."""
SAME = 3.0
"""Standard errors within which two explanations are as good as one another."""
MOST_TWINS = 3
CANDIDATES = 12
SERIES_SECONDS = 0.2


def diagnose(setup: Setup, logs: Sequence[Log], names: Sequence[str], without: Collection[str] = ()) -> Diagnosis:
    """Diagnose a log.

    Args:
        setup: what the robot's owner believes. logs, names: the log and its name.
        without: effects that may not be named, to see what the answer would be without them.

    Raises:
        UsageError: more than one log; this version diagnoses them one at a time.
    """
    if len(logs) != 1:
        raise UsageError(f"got {len(logs)} logs", field="LOG", remedy="diagnose one log at a time")
    problem, samples = make_problem(setup, logs[0])
    base = fits.base(problem)
    accepted, rounds = search(problem, base, without)
    before = hold_out(problem, base, base.error)
    after = hold_out(problem, accepted, base.error)
    gap = _gap(problem, before, after)
    found = tuple(finding for finding in samples.detected if finding.effect not in without)
    causes = _causes(problem, base, accepted, rounds, found)
    verdict = _verdict(problem, gap, causes, found, before, after)
    if verdict in ("unknown", "none"):
        causes = ()
    stages = tuple(dict.fromkeys(cause.stage for cause in causes))
    where = locate(*_residual(problem, before), _motion(problem, setup), stages)
    return Diagnosis(
        verdict=verdict,
        sentence=sentence_of(verdict, gap, causes),
        causes=causes,
        candidates=_ranking(problem, base, rounds, found),
        gap=gap,
        where=where,
        not_tested=_not_tested(problem, logs[0], without),
        series=(_series(problem, base, accepted, before, after),),
        logs=tuple(names),
    )


def _gap(problem: Problem, before: HeldOut, after: HeldOut) -> Gap:
    first, last = (excess_by_channel(problem, held.error) for held in (before, after))
    total, left = max(float(first.mean()), 0.0), max(float(last.mean()), 0.0)
    shrink = float(np.clip(1 - left / total, 0, 1)) if total > 0 else 0.0
    return Gap(
        before_rms=problem.noise_std * np.sqrt(1 + np.maximum(first, 0)),
        after_rms=problem.noise_std * np.sqrt(1 + np.maximum(last, 0)),
        noise_floor=problem.noise_std,
        before_sigmas=float(np.sqrt(1 + total)),
        after_sigmas=float(np.sqrt(1 + left)),
        shrink=shrink,
        shrink_stderr=min(excess_stderr(problem, after.error) / total, 1.0) if total > 0 else 0.0,
    )


def _verdict(
    problem: Problem,
    gap: Gap,
    causes: tuple[Candidate, ...],
    found: tuple[Finding, ...],
    before: HeldOut,
    after: HeldOut,
) -> str:
    before_gap, after_gap = np.sqrt(gap.before_sigmas**2 - 1), np.sqrt(gap.after_sigmas**2 - 1)
    quiet_before = before_gap < SILENT or gap.before_sigmas**2 - 1 < SAME * excess_stderr(problem, before.error)
    # What is left must be small for the owner and small against what was there.
    quiet_after = after_gap < max(SILENT, 0.1 * before_gap)
    of_the_mean = len(causes) > len(found)
    if not causes:
        return "none" if quiet_before else "unknown"
    if not of_the_mean:
        return "explained" if quiet_before else "partly_explained"
    if quiet_after:
        return "explained"
    return "partly_explained" if gap.shrink >= USEFUL_SHARE or found else "unknown"


def _causes(
    problem: Problem, base: Fit, accepted: Fit, rounds: list[list[Scored]], found: tuple[Finding, ...]
) -> tuple[Candidate, ...]:
    """Accepted hypotheses with their twins, and what was read off the samples; the larger gap first."""
    of_mean = []
    previous = base
    for scored, hypothesis in zip(rounds, accepted.hypotheses, strict=False):
        twins = _twins(problem, scored)
        values, stderr = parameters(problem, accepted, hypothesis)
        held = hold_out(problem, scored[0].fit, previous.error)
        reference = excess_by_channel(problem, base.error).mean()
        removed = excess_by_channel(problem, previous.error).mean() - excess_by_channel(problem, held.error).mean()
        of_mean.append(_candidate(hypothesis.effect, values, stderr, held, removed / max(reference, 1e-12), twins))
        previous = scored[0].fit
    of_samples = [_of_finding(finding, problem.duration) for finding in found]
    large = excess_by_channel(problem, base.error).mean() > SILENT**2
    return tuple(of_mean + of_samples if large else of_samples + of_mean)


def _twins(problem: Problem, scored: list[Scored]) -> tuple[str, ...]:
    """Effects of the same round that fit the log as well, within the error of the comparison of blocks."""
    best = scored[0]
    best_blocks = fits.block_scores(problem, best.fit)
    twins: dict[str, None] = {}
    for other in scored[1:]:
        difference = best_blocks - fits.block_scores(problem, other.fit)
        error = np.sqrt(len(difference)) * difference.std()
        close = best.gain - other.gain < max(SAME * error, 6.0) and other.gain > 0.95 * best.gain
        if close and other.hypothesis.effect != best.hypothesis.effect:
            twins[other.hypothesis.effect] = None
    return tuple(twins)[:MOST_TWINS]


def _candidate(
    effect: str, values: Parameters, stderr: Parameters, held: HeldOut, shrink: float, twins: tuple[str, ...] = ()
) -> Candidate:
    entry = CATALOGUE[effect]
    words = {twin.effect: twin.separate_by for twin in entry.twins}
    return Candidate(
        effect=effect,
        stage=entry.stage,
        indistinguishable_from=twins,
        separate_by=tuple(words.get(twin, "") for twin in twins),
        parameters=values,
        stderr=stderr,
        held_out_gain=held.gain,
        held_out_gain_stderr=held.gain_stderr,
        shrink=float(np.clip(shrink, 0, 1)),
        explanation=entry.explanation,
        remedy=entry.remedy,
    )


def _of_finding(finding: Finding, duration: float) -> Candidate:
    gain = finding.nats / max(duration, 1e-9)
    nothing = np.zeros((0, 6))
    held = HeldOut(nothing, gain, np.sqrt(2 * max(finding.nats, 0)) / max(duration, 1e-9))
    candidate = _candidate(
        finding.effect, cast(Parameters, finding.parameters), cast(Parameters, finding.stderr), held, 0.0
    )
    return candidate._replace(explanation=f"{candidate.explanation}: {finding.sentence}")


def _ranking(
    problem: Problem, base: Fit, rounds: list[list[Scored]], found: tuple[Finding, ...]
) -> tuple[Candidate, ...]:
    """Everything that was fitted by itself, best first."""
    ranked = [_of_finding(finding, problem.duration) for finding in found]
    total = max(float(excess_by_channel(problem, base.error).mean()), 1e-12)
    for scored in rounds[0][:CANDIDATES] if rounds else []:
        values, stderr = parameters(problem, scored.fit, scored.hypothesis)
        held = hold_out(problem, scored.fit, base.error)
        removed = 1 - float(excess_by_channel(problem, held.error).mean()) / total
        ranked.append(_candidate(scored.hypothesis.effect, values, stderr, held, removed))
    return tuple(sorted(ranked, key=lambda candidate: -candidate.held_out_gain))


def _not_tested(problem: Problem, log: Log, without: Collection[str]) -> tuple[tuple[str, str], ...]:
    reasons = [(name, "left out on request") for name in without]
    reasons += [(name, "the setup has it already") for name in problem.known]
    if not np.isfinite(log.temperature).any():
        reasons.append(("temperature_drift", "the log has no temperature"))
    return tuple(reasons)


def _residual(problem: Problem, held: HeldOut) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Innovations (B, 6) N, Nm, their noise (B, 6), and t (B,)."""
    used = problem.used
    noise = np.sqrt(np.asarray(problem.wrench.variance)[:used])
    seen = problem.samples[:used] > 0
    return np.where(seen, held.error * noise, np.nan), noise, np.asarray(problem.signals.t)[:used]


def _motion(problem: Problem, setup: Setup) -> Motion:
    signals, used = problem.signals, problem.used
    gravity = np.asarray(signals.model.gravity) / np.linalg.norm(setup.robot.gravity)
    R_base_sensor = jax.vmap(lambda q: sensor_pose(signals.model.arm, q)[0])(signals.q[:used:20])
    down = np.repeat(gravity @ np.asarray(R_base_sensor), 20, 0)[:used]
    load = np.linalg.norm(np.nan_to_num(np.asarray(problem.wrench.wrench)[:used, :3]), axis=1)
    temperature = np.asarray(signals.temperature)[:used]
    return Motion(
        speed=np.linalg.norm(np.asarray(signals.dq)[:used], axis=1),
        acceleration=np.linalg.norm(np.asarray(signals.ddq)[:used], axis=1),
        gravity=down,
        load_rate=np.gradient(load) if used > 1 else np.zeros(used),
        temperature=temperature if np.ptp(temperature) > 0 else None,
    )


def _series(problem: Problem, base: Fit, accepted: Fit, before: HeldOut, after: HeldOut) -> Series:
    """Coarse means of the innovations, and what the causes change in the reading."""
    first, noise, t = _residual(problem, before)
    last, _, _ = _residual(problem, after)
    z = jnp.asarray(np.stack([base.z, accepted.z]))
    readings = np.asarray(predict_many(problem.signals, problem.known, z, jnp.asarray([base.link, accepted.link])))[
        :, : problem.used
    ]
    change = readings[1] - readings[0]
    scaled = change / problem.noise_std
    channel = int(scaled.var(0).argmax())  # a constant change is no regressor
    block = np.unique((t / SERIES_SECONDS).astype(int), return_inverse=True)[1]
    count = np.bincount(block)

    def mean(x: np.ndarray) -> np.ndarray:
        return np.stack([np.bincount(block, column) for column in np.nan_to_num(x).T], -1) / count[:, None]

    return Series(
        t=mean(t[:, None])[:, 0],
        before=mean(first),
        after=mean(last),
        noise=np.sqrt(mean(noise**2) / count[:, None]),
        regressor=mean(change[:, channel : channel + 1])[:, 0],
        regressor_name=f"predicted change of {('fx', 'fy', 'fz', 'tx', 'ty', 'tz')[channel]} "
        + ("[N]" if channel < 3 else "[Nm]"),
    )
