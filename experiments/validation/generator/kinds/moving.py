"""Effects of motion: hoses, brakes, spinning wheels, entrained air, swinging loads, seals and twisted cables."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from validation.generator.arms import Floats
from validation.generator.effects.effect import Scene
from validation.generator.effects.rotor import Rotor
from validation.generator.effects.sprung import Sprung
from validation.generator.kinds.kind import (
    Hooks,
    Kind,
    between,
    direction,
    last_axis,
    last_joint,
    near_com,
    pushed,
    times,
    twisted,
)
from validation.generator.world import ToolPath


def hose(form: str, p: Any, scene: Scene) -> Hooks:
    """Hose pulled through a resistance: drag linear in a point's velocity (N s/m) or in its square (N s^2/m^2)."""

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        v = path.velocity(p.point)
        speed = np.linalg.norm(v, axis=1, keepdims=True) if form == "turbulent" else 1.0
        return -p.drag * speed * v, path.points(p.point)

    return pushed(load)


def trailing(form: str, p: Any, scene: Scene) -> Hooks:
    """Cable dragged over the table: friction (N) against the velocity; if it sticks, twice as large at low speed."""
    creep = 0.005  # m/s below which the cable does not slip

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        v = path.velocity(p.point)
        speed = np.linalg.norm(v, axis=1, keepdims=True)
        size = 1 + np.exp(-((speed / p.slow) ** 2)) * (form == "stribeck")
        return -p.friction * size * v / np.hypot(speed, creep), path.points(p.point)

    return pushed(load)


def spindle(form: str, p: Any, scene: Scene) -> Hooks:
    """Gyroscopic torque of a wheel at constant speed, or at a speed that varies by half, with its reaction torque."""
    top = p.momentum / p.inertia
    swing = 0.5 if form == "surging" else 0.0

    def speed(t: Floats) -> Floats:
        return top * (1 + swing * np.sin(2 * np.pi * t / p.period))

    return {"world": lambda world: replace(world, rotor=Rotor(p.axis, p.inertia, speed))}


def eddy_brake(form: str, p: Any, scene: Scene) -> Hooks:
    """Tool that turns in a magnetic field or a viscous liquid: torque against the angular velocity, or its square."""

    def couple(path: ToolPath) -> Floats:
        omega = path.angular_velocity()
        speed = np.linalg.norm(omega, axis=1, keepdims=True) if form == "square" else 1.0
        return -p.damping * speed * omega

    return twisted(couple)


def entrained(form: str, p: Any, scene: Scene) -> Hooks:
    """Entrained water or air: added mass (kg) against the acceleration of a point; for a plate, along its normal."""

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        a = path.acceleration(p.point)
        if form == "plate":
            across = path.rotation @ p.normal
            a = (a * across).sum(1, keepdims=True) * across
        return -p.mass * a, path.points(p.point)

    return pushed(load)


def dangling(form: str, p: Any, scene: Scene) -> Hooks:
    """Part of the tool's mass hangs as in a half-filled bottle, or is on soft lateral springs, its weight balanced."""
    kind = "pendulum" if form == "pendulum" else "lateral"
    part = Sprung(kind, p.share, p.hz, p.zeta, counterbalanced=kind == "lateral")
    return {"world": lambda world: replace(world, sprung=part)}


def bundle(form: str, p: Any, scene: Scene) -> Hooks:
    """Cables through the last joint, twisted by it: stiffness in Nm/rad, or in Nm/rad^3."""
    axis = last_axis(scene.world)

    def couple(path: ToolPath) -> Floats:
        twist = scene.motion(path.t)[0][:, -1] - p.relaxed
        size = -p.stiffness * (twist if form == "linear" else twist**3)
        return size[:, None] * (path.rotation @ axis)

    return twisted(couple)


def seal(form: str, p: Any, scene: Scene) -> Hooks:
    """Rotary feedthrough on the last joint with a fixed housing: friction against its speed, Nm s/rad or Nm."""
    axis = last_axis(scene.world)

    def couple(path: ToolPath) -> Floats:
        speed = scene.motion(path.t)[1][:, -1]
        size = -p.friction * (speed if form == "viscous" else np.tanh(speed / 0.01))
        return size[:, None] * (path.rotation @ axis)

    return twisted(couple)


MOVING = (
    Kind(
        *("hose", "velocity", "base", "force", ("viscous", "turbulent")),
        {"drag": times(3.0), "point": near_com()},
        hose,
        known=lambda form, p: {"N_per_m_s" if form == "viscous" else "N_per_m_s2": p.drag},
        sometimes=("joint_velocity",),
        brisk=True,
    ),
    Kind(
        *("trailing", "velocity", "base", "force", ("coulomb", "stribeck")),
        {"friction": times(1.0), "slow": lambda form, draw, scene: 0.1, "point": near_com()},
        trailing,
        known=lambda form, p: {"N": p.friction} if form == "coulomb" else {},
        unseen=True,
        sometimes=("joint_velocity",),
    ),
    Kind(
        *("spindle", "angular_velocity", "sensor", "torque", ("steady", "surging")),
        {
            "momentum": times(0.05),
            "axis": direction,
            "inertia": lambda form, draw, scene: 0.05 * float(np.linalg.eigvalsh(scene.belief.tool.inertia)[0]),
            "period": between(6.0, 12.0),
        },
        spindle,
        known=lambda form, p: {"Nm_per_rad_s": p.momentum * p.axis},  # its mean in the form "surging"
        sometimes=("joint_velocity",),
        brisk=True,
    ),
    Kind(
        *("eddy_brake", "angular_velocity", "base", "torque", ("linear", "square")),
        {"damping": times(0.05)},
        eddy_brake,
        known=lambda form, p: {"Nm_per_rad_s" if form == "linear" else "Nm_per_rad_s2": p.damping},
        unseen=True,
        sometimes=("joint_velocity",),
        brisk=True,
    ),
    Kind(
        *("entrained", "acceleration", "base", "force", ("sphere", "plate")),
        {"mass": times(0.5), "point": near_com(), "normal": direction},
        entrained,
        known=lambda form, p: {"N_per_m_s2": p.mass},
        brisk=True,
    ),
    Kind(
        *("dangling", "acceleration", "sensor", "wrench", ("pendulum", "soft_mount")),
        {
            "share": lambda form, draw, scene: min(0.25 * draw.scale, 0.75),
            "hz": lambda form, draw, scene: draw.rng.uniform(*((1.3, 2.2) if form == "pendulum" else (1.5, 3.0))),
            "zeta": between(0.03, 0.15),
        },
        dangling,
        known=lambda form, p: {"frequency": p.hz, "damping_ratio": p.zeta},
        unseen=True,
        twins=("tool_flexibility",),
        brisk=True,
    ),
    Kind(
        *("bundle", "joint_angle", "joint", "torque", ("linear", "stiffening")),
        {
            "stiffness": times(0.05),
            "relaxed": lambda form, draw, scene: float(scene.belief.arm.home[-1] + draw.rng.uniform(-0.5, 0.5)),
            "joint": last_joint,
        },
        bundle,
        known=lambda form, p: {"Nm_per_rad" if form == "linear" else "Nm_per_rad3": -p.stiffness},
    ),
    Kind(
        *("seal", "joint_velocity", "joint", "torque", ("viscous", "dry")),
        {"friction": times(0.05), "joint": last_joint},
        seal,
        known=lambda form, p: {"Nm_per_rad_s" if form == "viscous" else "Nm": p.friction},
        sometimes=("angular_velocity",),
    ),
)
