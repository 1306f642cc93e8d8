"""Gains and leaks of a sensor's channels that a log shows, in a setup: its effects ``gain`` and ``crosstalk``."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ftbias_jax.calibration.tool.channels import LEVER, Channels, fit_channels
from ftbias_jax.filtering.method.ready import filtered_with
from ftbias_jax.io.log import Log
from ftbias_jax.model.effects.catalogue import values_from_setup
from ftbias_jax.model.own_effects import catalogue_of_setup
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import AXES, Array


def find_channels(setup: Setup, log: Log) -> Channels:
    """How the channels read what the setup expects, by a log that turns the tool.

    Args:
        setup: with the tool of the log.
        log: of free motion.
    """
    result, _ = filtered_with(replace(setup, bias=replace(setup.bias, adapt=True)), log)
    measured = result.wrench_tool - (result.wrench_unbiased - result.bias)
    if result.used is not None:
        measured = np.where(result.used[:, None], measured, np.nan)
    drift_std = np.asarray(setup.bias.initial_drift_std, float)
    return fit_channels(result.t - log.start, result.wrench_tool, measured, drift_std, tuple(log.rezeroed_at))


def with_channels(setup: Setup, found: Channels) -> Setup:
    """The setup with gains and leaks beside those it has; as it is if the log does not show any."""
    if not found.shown:
        return setup
    matrix = found.matrix @ _stated(setup)
    gain = np.diag(matrix)
    effects = {**setup.effects, "gain": {"gain": gain}, "crosstalk": {"matrix": matrix / gain}}
    comments = {
        "effects.gain.gain": f"identified ± {_words(np.diag(found.stderr))}",
        "effects.crosstalk.matrix": f"identified; leaks between forces ± {found.stderr[:3, :3].max():.2g} or less",
    }
    return replace(setup, effects=effects, comments={**setup.comments, **comments})


def in_words(found: Channels) -> list[str]:
    """Lines that tell what was found."""
    nats = f"{found.held_out[0]:.0f} ± {found.held_out[1]:.0f} nats on blocks left out"
    if not found.shown:
        return [f"gains and crosstalk: not shown by this log ({nats}), not written"]
    lines = [f"gains and crosstalk ({nats}): what each channel reads of loads by 1 N and 0.1 Nm"]
    lines.append(" " * 8 + "".join(f"{name:>8s}" for name in AXES))
    scaled = found.matrix * LEVER
    lines += [f"{name:8s}" + "".join(f"{x:8.3f}" for x in row) for name, row in zip(AXES, scaled, strict=True)]
    return lines


def _stated(setup: Setup) -> Array:
    """(6, 6) what the setup states already: crosstalk after gain."""
    values = values_from_setup(setup.effects, setup.path, catalogue_of_setup(setup))
    gain, leak = np.eye(6), np.eye(6)
    if "gain" in values:
        gain = np.diag(np.asarray(values["gain"]["gain"], float))
    if "crosstalk" in values:
        matrix = np.asarray(values["crosstalk"]["matrix"], float)
        leak = np.where(np.eye(6) > 0, 1.0, matrix)
    return leak @ gain


def _words(values: Array) -> str:
    return " ".join(f"{x:.2g}" for x in values)
