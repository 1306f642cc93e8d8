"""What ``tune`` gives: a setup with tuned noise, how well each number is known, and its scores."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ftbias_jax.calibration.data_noise_values import setup_from_values
from ftbias_jax.calibration.tune import Fit
from ftbias_jax.model.params import Params
from ftbias_jax.setup.types import Setup


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
    others: tuple[Setup, ...] = ()
    """The setups of further tools, with the same noise."""

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


def _table(fit: Fit) -> str:
    lines = []
    for name, values in fit.values.items():
        errors = fit.relative_stderr[name] * values
        lines.append(f"{name:16s} " + "  ".join(f"{x:.3g} ± {e:.1g}" for x, e in zip(values, errors, strict=True)))
    found = fit.optimum
    lines.append(f"{'':16s} log-likelihood {found.value:.1f} nats; {found.agreeing} of {found.starts} starts agree")
    lines += [f"{'':16s} not determined by these logs: {words}" for words in fit.undetermined]
    lines += [f"{'':16s} determined: {words}" for words in fit.determined]
    return "\n".join(lines)


def with_noise(setup: Setup, params: Params, fits: dict[str, Fit]) -> Setup:
    """The setup with the noise that was fitted."""
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
            data_noise=setup_from_values(fits["wrench"].values) or setup.data_noise,
        )
    return setup


def comments_of(fits: dict[str, Fit]) -> dict[str, str]:
    """Relative standard errors, for the lines of a setup."""
    keys = {
        "process_density": "joints.process_noise_density",
        "position_std": "joints.position_noise_std",
        "velocity_std": "joints.velocity_noise_std",
        "density": "bias.noise_density",
        "wrench_std": "sensor.noise_std",
    }
    comments = {
        keys.get(name, f"data_noise.{name}"): "tuned, relative standard errors " + " ".join(f"{x:.1g}" for x in errors)
        for fit in fits.values()
        for name, errors in fit.relative_stderr.items()
    }
    density = keys["process_density"]
    return {key: words + ("; ftbias filter multiplies it" if key == density else "") for key, words in comments.items()}
