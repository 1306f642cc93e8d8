"""Result of ``tune``: a setup with tuned noise, how well each value is known, and its scores."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ftbias_jax.calibration.judgement import LEAST_LOSS, HeldOut, Predicted
from ftbias_jax.calibration.noise.values import key_of, setup_from_values
from ftbias_jax.calibration.tune import Fit
from ftbias_jax.filtering.verbs.setup_with import setup_with
from ftbias_jax.model.params import Params, params_from_setup
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import AXES

OPEN = 3.0
"""Relative standard error from which on a value counts as not determined by the logs."""


@dataclass(frozen=True, eq=False)
class TuneResult:
    """A setup with tuned noise, and how well the logs determine each value."""

    setup: Setup
    """Setup with the tuned noise; ``save`` writes relative standard errors beside it."""
    fits: dict[str, Fit]
    """Fits by name, "joints" and "wrench", as far as they were asked for."""
    held_out: tuple[HeldOut, ...]
    """Log-likelihood scores on the held-out end of every log; () if nothing was held out."""
    others: tuple[Setup, ...] = ()
    """Setups of the further tools, with the same noise."""
    predicted: tuple[Predicted, ...] = ()
    """Prediction errors of the reading on the end of every log, before and after; () if nothing was held out."""
    reasons: tuple[str, ...] = ()
    """Why the result should not be used; () if it is no worse than the setup was."""

    @property
    def converged(self) -> bool:
        """Whether all fits reached their maximum; if not, the values are the best so far."""
        return all(fit.optimum.converged for fit in self.fits.values())

    @property
    def refusals(self) -> tuple[str, ...]:
        """Why no command writes the setup unless forced: the reasons, and a fit that did not converge."""
        return self.reasons if self.converged else (*self.reasons, "a fit did not converge")

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the tuned setup; raises what ``Setup.save`` raises.

        Args:
            path: path of the TOML file.
        """
        self.setup.save(path)

    def __str__(self) -> str:
        scores = [
            f"held-out {part} score: {before:.1f} -> {after:.1f} nats/s ({after - before:+.1f} ± {stderr:.1g})"
            for part, before, after, stderr in self.held_out
        ]
        errors = [
            f"reading predicted {p.seconds:g} s ahead, rms: "
            + "  ".join(
                f"{name} {was:.3g} -> {now:.3g}" for name, was, now in zip(AXES, p.before, p.after, strict=True)
            )
            for p in self.predicted
        ]
        advice = _advice(self.predicted)
        return "\n".join([*map(_table, self.fits.values()), *_correlated(self.setup), *scores, *errors, *advice])


def _advice(predicted: Sequence[Predicted]) -> list[str]:
    """Advice where a constant bias, taken from the log and held, predicts better: it can be given to later logs."""
    found = [(p.seconds, better) for p in predicted if (better := [x for x in p.constant_better if x.startswith("f")])]
    if not found:
        return []
    where = " and ".join(f"{seconds:g} s ahead on {', '.join(axes)}" for seconds, axes in found)
    return [
        f"a constant bias, the mean of what was fitted, predicts better {where}: `ftbias identify --crosstalk --bias` "
        "hands one over to logs that are recorded before the sensor is zeroed again"
    ]


def _correlated(setup: Setup) -> list[str]:
    """Lines with the parameters of noise that is correlated in time, if the setup states it."""
    std, time = setup.sensor.correlated_std, setup.sensor.correlated_time
    if std is None or time is None:
        return []
    rows = {"correlated_std": std, "correlated_time": time}
    if setup.bias.drift_time is not None:
        rows["drift_time"] = setup.bias.drift_time
    return [f"{name:16s} " + "  ".join(f"{x:.3g}" for x in row) for name, row in rows.items()]


def reasons_against(scores: Sequence[HeldOut], predicted: Sequence[Predicted], shown: Sequence[str]) -> tuple[str, ...]:
    """Reasons not to use a tuned setup, and what the logs show instead; () if it is no worse than before."""
    reasons = [
        f"the score of unseen {score.part} data falls by {score.before - score.after:.3g} nats/s"
        for score in scores
        if score.falls
    ]
    for p in predicted:
        if forces := [name for name in p.worse if name.startswith("f")]:
            reasons.append(f"the reading is predicted worse {p.seconds:g} s ahead on {', '.join(forces)}")
    return (*reasons, f"the logs show {', '.join(shown)}") if reasons and shown else tuple(reasons)


def is_better(moving: TuneResult, plain: TuneResult) -> bool:
    """Whether a fit with noise that grows with the motion scores better on held-out data than the fit without it."""
    gain = moving.held_out[-1].after - plain.held_out[-1].after
    return gain > LEAST_LOSS and (not moving.reasons or bool(plain.reasons))


def with_fit(wrench: Fit | None, motion: Fit) -> Fit:
    """Fit of the wrench's noise, completed by the fit of noise that grows with the motion."""
    if wrench is None:
        return motion
    return motion._replace(
        values={**wrench.values, **motion.values},
        relative_stderr={**wrench.relative_stderr, **motion.relative_stderr},
        undetermined=[*(() if "density" in motion.values else wrench.undetermined), *motion.undetermined],
    )


def _table(fit: Fit) -> str:
    lines = []
    for name, values in fit.values.items():
        # One row of six axes per joint for a parameter that every joint has.
        for row, relative in zip(np.atleast_2d(values), np.atleast_2d(fit.relative_stderr[name]), strict=True):
            errors = zip(row, relative * row, strict=True)
            shown = (f"{x:.3g} ± {e:.1g}" if np.isfinite(e) else f"{x:.3g} (open)" for x, e in errors)
            lines.append(f"{name:16s} " + "  ".join(shown))
    found = fit.optimum
    lines.append(f"{'':16s} log-likelihood {found.value:.1f} nats; {found.agreeing} of {found.starts} starts agree")
    lines += [f"{'':16s} not determined by these logs: {words}" for words in fit.undetermined]
    lines += [f"{'':16s} determined: {words}" for words in fit.determined]
    return "\n".join(lines)


def with_noise(setup: Setup, params: Params, fits: dict[str, Fit]) -> Setup:
    """The setup with the fitted noise."""
    stated, wrench = params_from_setup(setup), fits.get("wrench")
    if "joints" not in fits:
        params = params._replace(joint=stated.joint)
    if wrench is None:
        return setup_with(setup, params, guarded=False)
    density, variance = np.asarray(params.bias.density), np.asarray(params.bias.wrench_variance)
    # Axes that the logs leave open keep the given values.
    if "density" in wrench.relative_stderr:
        density = np.where(wrench.relative_stderr["density"] < OPEN, density, setup.bias.noise_density)
    parts = setup_from_values(wrench.values)  # as fitted, because Params holds only the sum of the parts
    if "wrench_std" in wrench.relative_stderr and parts is None:
        variance = np.where(wrench.relative_stderr["wrench_std"] < OPEN, variance, setup.sensor.noise_std**2)
    params = params._replace(bias=params.bias._replace(density=density, wrench_variance=variance))
    if parts is not None:
        params = params._replace(bias=params.bias._replace(data_variance=stated.bias.data_variance))
    written = setup_with(setup, params, guarded=False)
    return written if parts is None else replace(written, data_noise=parts)


def comments_of(fits: dict[str, Fit]) -> dict[str, str]:
    """Comments with relative standard errors, by key of the setup."""
    comments = {
        key_of(name): "tuned, relative standard errors " + " ".join(f"{x:.1g}" for x in errors.ravel())
        for fit in fits.values()
        for name, errors in fit.relative_stderr.items()
    }
    density = key_of("process_density")
    return {key: words + ("; ftbias filter multiplies it" if key == density else "") for key, words in comments.items()}
