"""The verb ``tune``: a setup with the likeliest noise of logs, judged on what it has not seen."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import jax
import numpy as np

from ftbias_jax.calibration import newton
from ftbias_jax.calibration.tune import JOINT_NAMES, TIES, Fit, tune_joints, tune_wrench
from ftbias_jax.errors import UsageError
from ftbias_jax.filtering import filter_log
from ftbias_jax.filtering.likelihood import joint_log_likelihood, wrench_given_joints
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.filtering.samples import samples_from_log
from ftbias_jax.io.log import Log
from ftbias_jax.model.params import Params
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Sample

FIT = ("joints", "bias", "sensor")
"""What can be fitted: joint noise, sigma_Q, sensor noise."""

ReportFit = Callable[[str, int, float], None]
"""Told ("joints" or "wrench", iteration, nats)."""


class HeldOut(NamedTuple):
    """Log-likelihood of what the fit has not seen, nats a second."""

    part: str
    """"joint" or "wrench"."""
    before: float
    """With the noise of the setup."""
    after: float
    """With the tuned noise."""


@dataclass(frozen=True, eq=False)
class TuneResult:
    """A setup with tuned noise, and what the logs say about each number."""

    setup: Setup
    """With the tuned noise; ``save`` writes relative standard errors beside it."""
    fits: dict[str, Fit]
    """"joints" and "wrench", as far as they were asked for."""
    held_out: tuple[HeldOut, ...]
    """Scores on the end of every log; () if nothing was held out."""

    @property
    def converged(self) -> bool:
        """Whether all fits found their maximum; if not, the values are the best so far."""
        return all(fit.optimum.converged for fit in self.fits.values())

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the tuned setup; ``Setup.save`` has the errors.

        Args:
            path: of the TOML file.
        """
        self.setup.save(path)

    def __str__(self) -> str:
        scores = [
            f"held-out {part} score: {before:.1f} -> {after:.1f} nats/s ({after - before:+.1f})"
            for part, before, after in self.held_out
        ]
        return "\n".join([*map(_table, self.fits.values()), *scores])


def _nobody(label: str, iteration: int, value: float) -> None:
    """Reports to nobody."""


@in_float64
def tune(
    setup: Setup,
    logs: Sequence[Log],
    *,
    fit: Collection[str] = FIT,
    tie: str = "each",
    restarts: int = 1,
    hold_out: float = 0.25,
    start: Log | None = None,
    report: ReportFit = _nobody,
    total: newton.Total = newton.alone,
) -> TuneResult:
    """Fit the noise of joints, bias and sensor to logs by maximum likelihood.

    Computes in float64 whatever JAX's setting is, and keeps compiled programs in the user's cache folder
    (``FTBIAS_CACHE=off`` does not).

    Args:
        setup: robot, sensor, tool, and noise to start from.
        logs: of one robot and sensor, as ``read_log`` gives them.
        fit: some of FIT.
        tie: whether sigma_Q and the sensor's noise have a value for "each" axis, for a "pair" of forces and torques, or
            "one" for all.
        restarts: further starts, all values off by random factors, to see whether they agree.
        hold_out: share at the end of every log that is kept to judge by, 0 to 0.9.
        start: the log whose likeliest joint noise to start from; None = the first one.
        report: told of every iteration.
        total: adds up the processes that tune together, as ``distributed.total`` does.

    Raises:
        UsageError: no log, or a name or share that does not exist.
    """
    _check(logs, fit, tie, hold_out)
    options = Options(joint_model=setup.joints.model)
    stated = params = filter_log.likeliest_params(setup, samples_from_log(start or logs[0]), options)
    samples = [samples_from_log(filter_log.without_useless(log, params)) for log in logs]
    seen = [_part(log, 0, 1 - hold_out) for log in samples]
    fits: dict[str, Fit] = {}
    # The wrench needs the likeliest process noise of the joints, even if nobody asked for it.
    names = JOINT_NAMES if "joints" in fit else JOINT_NAMES[:1]
    told = partial(report, "joints")
    params, joints = tune_joints(
        params, seen, dict.fromkeys(names, "each"), options, restarts=restarts, report=told, total=total
    )
    if "joints" in fit:
        fits["joints"] = joints
    ties = {"density": "bias", "wrench_std": "sensor"}
    wanted = {name: tie for name, part in ties.items() if part in fit}
    if wanted:
        told = partial(report, "wrench")
        params, fits["wrench"] = tune_wrench(params, seen, wanted, options, restarts=restarts, report=told, total=total)
    scores: tuple[HeldOut, ...] = ()
    if hold_out:
        scores = _judge(stated, params, [_part(log, 1 - hold_out, 1) for log in samples], options, total)
    tuned = _with_noise(setup, params, fits)
    return TuneResult(replace(tuned, comments={**setup.comments, **_comments(fits)}), fits, scores)


def _check(logs: Sequence[Log], fit: Collection[str], tie: str, hold_out: float) -> None:
    if not logs:
        raise UsageError("there is no log to tune to", field="logs", remedy="give at least one")
    if unknown := [name for name in fit if name not in FIT]:
        raise UsageError(f"cannot fit {unknown[0]!r}", field="fit", remedy=f"choose from {', '.join(FIT)}")
    if not fit:
        raise UsageError("there is nothing to fit", field="fit", remedy=f"choose from {', '.join(FIT)}")
    if tie not in TIES:
        raise UsageError(f"got {tie!r}", field="tie", remedy=f"choose from {', '.join(TIES)}")
    if not 0 <= hold_out <= 0.9:
        raise UsageError(f"got {hold_out!r}", field="hold_out", remedy="give a share from 0 to 0.9")


def _judge(
    before: Params, after: Params, unseen: Sequence[Sample], options: Options, total: newton.Total
) -> tuple[HeldOut, ...]:
    """Scores of two sets of parameters on logs that neither has seen."""
    seconds = sum(float(part.dt.sum()) for part in unseen)
    scores = []
    for likelihood in (joint_log_likelihood, wrench_given_joints):
        score = jax.jit(partial(likelihood, options=options, burn_in=1.0))
        scores += [sum(float(score(p, x)) for x in unseen) for p in (before, after)]
    seconds, found = total(seconds, np.array(scores))
    pairs = found.reshape(2, 2) / seconds
    return tuple(HeldOut(name, *map(float, pair)) for name, pair in zip(("joint", "wrench"), pairs, strict=True))


def _part(samples: Sample, begin: float, end: float) -> Sample:
    """A share of a log as a log of its own."""
    rows = slice(round(begin * len(samples.dt)), round(end * len(samples.dt)))
    part = Sample(*(None if x is None else np.asarray(x)[rows] for x in samples))
    return part._replace(dt=np.concatenate([[0], part.dt[1:]]))


def _table(fit: Fit) -> str:
    lines = []
    for name, values in fit.values.items():
        errors = fit.relative_stderr[name] * values
        lines.append(f"{name:16s} " + "  ".join(f"{x:.3g} ± {e:.1g}" for x, e in zip(values, errors, strict=True)))
    found = fit.optimum
    lines.append(f"{'':16s} log-likelihood {found.value:.1f} nats; {found.agreeing} of {found.starts} starts agree")
    lines += [f"{'':16s} not determined by these logs: {words}" for words in fit.undetermined]
    return "\n".join(lines)


def _with_noise(setup: Setup, params: Params, fits: dict[str, Fit]) -> Setup:
    if "joints" in fits:
        joints = replace(
            setup.joints,
            process_noise_density=np.asarray(params.joint.process_density),
            position_noise_std=np.asarray(params.joint.position_std),
            velocity_noise_std=np.asarray(params.joint.velocity_std),
        )
        setup = replace(setup, joints=joints)
    if "wrench" in fits:
        setup = replace(
            setup,
            bias=replace(setup.bias, noise_density=np.asarray(params.bias.density)),
            sensor=replace(setup.sensor, noise_std=np.sqrt(np.asarray(params.bias.wrench_variance))),
        )
    return setup


def _comments(fits: dict[str, Fit]) -> dict[str, str]:
    keys = {
        "process_density": "joints.process_noise_density",
        "position_std": "joints.position_noise_std",
        "velocity_std": "joints.velocity_noise_std",
        "density": "bias.noise_density",
        "wrench_std": "sensor.noise_std",
    }
    comments = {
        keys[name]: "tuned, relative standard errors " + " ".join(f"{x:.1g}" for x in errors)
        for fit in fits.values()
        for name, errors in fit.relative_stderr.items()
    }
    density = keys["process_density"]
    return {key: words + ("; ftbias filter multiplies it" if key == density else "") for key, words in comments.items()}
