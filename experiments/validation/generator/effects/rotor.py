"""A wheel that spins inside the tool: its MuJoCo body and its motion in time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import cumulative_trapezoid

from validation.generator.arms import Floats
from validation.generator.nominal_model import Tool

WHEEL_MASS = 1e-6  # kg; only the wheel's inertia matters, and the whole tool keeps its stated mass


@dataclass(frozen=True)
class Rotor:
    """A wheel at the tool's centre of mass and part of the tool, so that it has no effect at standstill."""

    axis: Floats
    """(3,) unit vector, tool frame."""
    inertia: float
    """kg m^2, about all axes."""
    speed: Callable[[Floats], Floats]
    """Times (T,) s -> speed (T,) rad/s relative to the tool."""


def rotor_mjcf(tool: Tool, rotor: Rotor | None) -> tuple[Tool, str]:
    """Return the tool without its wheel, and the MJCF body of the wheel (empty without one)."""
    if rotor is None:
        return tool, ""
    still = replace(tool, mass=tool.mass - WHEEL_MASS, inertia=tool.inertia - rotor.inertia * np.eye(3))
    axis, place = (" ".join(repr(float(x)) for x in values) for values in (rotor.axis, tool.com))
    diagonal = " ".join([repr(float(rotor.inertia))] * 3)
    body = (
        f'<body pos="{place}"><joint type="hinge" axis="{axis}"/>'
        f'<inertial pos="0 0 0" mass="{WHEEL_MASS!r}" diaginertia="{diagonal}"/></body>'
    )
    return still, body


def spinning(rotor: Rotor, q: Floats, dq: Floats, ddq: Floats, t: Floats) -> tuple[Floats, Floats, Floats]:
    """Positions, velocities, accelerations (T, n + 1) of arm and wheel together at the times t (T,) s."""
    speed = rotor.speed(t)
    angle = cumulative_trapezoid(speed, t, initial=0.0)
    wheel = (angle % (2 * np.pi), speed, np.gradient(speed, t))
    together = [np.column_stack([arm, own]) for arm, own in zip((q, dq, ddq), wheel, strict=True)]
    return together[0], together[1], together[2]
