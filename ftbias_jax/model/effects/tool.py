"""Effects of the tool stage: the tool differs from the setup. Data-sheet values replace those of theta."""

from typing import Any

import numpy as np

from ftbias_jax.model.effects.fitting import Fitting, Linear
from ftbias_jax.model.effects.statements import amount, distance
from ftbias_jax.model.effects.types import Effect, EffectValues, Parameter, Signals, Twin, within
from ftbias_jax.model.wrench.inertia import about_center_of_mass, center_of_mass
from ftbias_jax.model.wrench.tool_wrench import tool_parameters
from ftbias_jax.setup.types import inertia_matrix
from ftbias_jax.types import Array

_MOMENTS = ("Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
SURE = 2.0
"""Number of standard errors below zero from which on a moment of inertia counts as negative."""
REMEDY = "weigh or re-measure the tool: ftbias identify"


def tool_mass(values: EffectValues, signals: Signals) -> Signals:
    """Another mass at the same centre of mass, with the same inertia about it."""
    _, center_of_mass, inertia = about_center_of_mass(signals.model.theta)
    return _with_theta(signals, tool_parameters(values["mass"], center_of_mass, inertia))


def tool_com(values: EffectValues, signals: Signals) -> Signals:
    """Another centre of mass, with the same mass and inertia about it."""
    mass, _, inertia = about_center_of_mass(signals.model.theta)
    return _with_theta(signals, tool_parameters(mass, values["center_of_mass"], inertia))


def tool_inertia(values: EffectValues, signals: Signals) -> Signals:
    """Another inertia about the same centre of mass."""
    mass, center_of_mass, _ = about_center_of_mass(signals.model.theta)
    return _with_theta(signals, tool_parameters(mass, center_of_mass, values["inertia"]))


def _of_a_body(values: dict[str, Any], stderr: dict[str, Any]) -> bool:
    """Whether no principal moment of inertia is significantly negative."""
    moments = np.linalg.eigvalsh(inertia_matrix(np.asarray(values["inertia"])))
    return bool(moments[0] > -SURE * np.max(stderr["inertia"]))


def _with_theta(signals: Signals, theta: Array) -> Signals:
    return signals._replace(model=signals.model._replace(theta=theta))


EFFECTS = (
    Effect(
        "tool_mass",
        "tool",
        (
            Parameter(
                "mass",
                "kg",
                "mass of everything distal of the sensor",
                **within((), 1e-3, 1e3, lambda model: model.theta[0], 0.05, stated="mass"),
            ),
        ),
        "the tool is heavier or lighter than the setup says",
        REMEDY,
        transform=tool_mass,
        fit=Fitting(Linear()),
        twins=(
            Twin("gain", False, "hang a known weight on the tool: a gain scales it too, a wrong mass does not"),
            Twin("tool_com", False, "turn the wrist through all directions of gravity"),
        ),
        statement=amount("the tool weighs {value} kg{setup}", "mass"),
    ),
    Effect(
        "tool_com",
        "tool",
        (
            Parameter(
                "center_of_mass",
                "m",
                "centre of mass, sensor frame",
                **within((3,), -10.0, 10.0, lambda model: center_of_mass(model.theta), 0.006, stated="center_of_mass"),
            ),
        ),
        "the tool's centre of mass is not where the setup says",
        REMEDY,
        transform=tool_com,
        fit=Fitting(Linear()),
        twins=(
            Twin("none", True, "a torque bias when the wrist does not turn: turn it about two axes"),
            Twin("gain", False, "turn the wrist: a gain changes the forces too"),
        ),
        statement=distance(
            "the tool's centre of mass is {value} off the setup, mostly along {axis}", "center_of_mass", "mm", 1e3
        ),
    ),
    Effect(
        "tool_inertia",
        "tool",
        (
            Parameter(
                "inertia",
                "kg m^2",
                "Ixx Ixy Ixz Iyy Iyz Izz about the centre of mass, sensor axes",
                **within((6,), -100.0, 100.0, lambda model: about_center_of_mass(model.theta)[2], 5e-4),
            ),
        ),
        "the tool's inertia is not what the setup says",
        "identify it from fast wrist motion: ftbias identify",
        transform=tool_inertia,
        # An arm that rotates the sensor also accelerates it; if that is not recorded, it appears as inertia.
        needs_motion="acceleration",
        fit=Fitting(Linear(), possible=_of_a_body, unmeasured=lambda setup: True),
        twins=(Twin("tool_flexibility", False, "accelerate the wrist at several frequencies"),),
        statement=distance(
            "the tool's inertia departs from the setup's by {value}, mostly in {axis}",
            "inertia",
            "kg m^2",
            labels=_MOMENTS,
        ),
    ),
)
