"""Whether setups differ in the tool alone, so that their logs have the same noise."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from ftbias_jax.errors import SetupError
from ftbias_jax.setup.fields import show
from ftbias_jax.setup.types import Setup

_OWN = {
    "bias": ("initial", "initial_drift", "initial_std", "initial_drift_std"),
    "sensor": ("rotation_rpy", "rezeroed", "rezeroed_at"),
    "robot": ("position_limits", "velocity_limits"),
}
"""What may differ beside the tool: the prior of the bias, how the rotation was written, and the same arm's limits."""


def require_one_robot(first: Setup, other: Setup) -> None:
    """Refuse a setup that differs from the first one in more than tool and prior of the bias.

    Raises:
        SetupError: names the first difference.
    """
    for section in ("robot", "sensor", "bias", "joints", "data_noise", "effects", "pose"):
        one, two = getattr(first, section), getattr(other, section)
        name = "sensor_pose" if section == "pose" else section
        if one is None or two is None or isinstance(one, dict):
            _compare(first, other, name, one, two)
            continue
        for field in fields(one):
            if field.name not in _OWN.get(section, ()):
                _compare(first, other, f"{name}.{field.name}", getattr(one, field.name), getattr(two, field.name))


def _compare(first: Setup, other: Setup, field: str, one: object, two: object) -> None:
    if np.array_equal(one, two):  # type: ignore[arg-type]  # of words and tables, too
        return
    message = f"{_shown(two)} differs from {_shown(one)} in {first.path or 'the first setup'}"
    remedy = "setups of several tools share robot, sensor and noise; [tool] and the bias's initial values may differ"
    raise SetupError(message, file=other.path, field=field, remedy=remedy)


def _shown(value: object) -> str:
    return show(value.tolist() if isinstance(value, np.ndarray) else value)
