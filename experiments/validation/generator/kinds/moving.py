"""What the motion of the tool costs: hoses, brakes, spinning wheels, air carried along, loads that swing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from validation.generator.arms import Floats
from validation.generator.effects.effect import Draw, Effect, Scene
from validation.generator.effects.rotor import Rotor
from validation.generator.effects.sprung import Sprung
from validation.generator.kinds.kind import Parameters, loaded, near, twisted, vector
from validation.generator.world import ToolPath


def draw_hose(form: str, draw: Draw, scene: Scene) -> Parameters:
    """A hose pulled through something that resists."""
    return {"drag": 3.0 * draw.scale, "point": vector(near(scene.belief.tool.com, draw))}


def build_hose(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """A force against the velocity of a point. Forms: "viscous" (N s/m), "turbulent" (its square, N s^2/m^2)."""
    point = np.array(parameters["point"])

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        v = path.velocity(point)
        speed = np.linalg.norm(v, axis=1, keepdims=True) if form == "turbulent" else 1.0
        return -parameters["drag"] * speed * v, path.points(point)

    return loaded("hose", form, parameters, load)


def hose_coefficients(form: str, parameters: Parameters) -> dict[str, float]:
    """Against the velocity."""
    return {"N_per_m_s" if form == "viscous" else "N_per_m_s2": parameters["drag"]}


def draw_trailing(form: str, draw: Draw, scene: Scene) -> Parameters:
    """A cable that lies on the table and is dragged along."""
    return {"friction": draw.scale, "slow": 0.1, "point": vector(near(scene.belief.tool.com, draw))}


def build_trailing(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """A force of fixed size against the velocity. Forms: "coulomb", "stribeck" (sticks: twice as much when slow)."""
    point, creep = np.array(parameters["point"]), 0.005  # m/s below which it does not slip

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        v = path.velocity(point)
        speed = np.linalg.norm(v, axis=1, keepdims=True)
        size = 1 + np.exp(-((speed / parameters["slow"]) ** 2)) * (form == "stribeck")
        return -parameters["friction"] * size * v / np.hypot(speed, creep), path.points(point)

    return loaded("trailing", form, parameters, load)


def trailing_coefficients(form: str, parameters: Parameters) -> dict[str, float]:
    """Of the friction that does not depend on speed."""
    return {"N": parameters["friction"]} if form == "coulomb" else {}


def draw_spindle(form: str, draw: Draw, scene: Scene) -> Parameters:
    """A spindle runs in the tool."""
    inertia = 0.05 * float(np.linalg.eigvalsh(scene.belief.tool.inertia)[0])
    momentum = 0.05 * draw.scale
    return {
        "momentum": momentum,
        "axis": vector(draw.direction()),
        "inertia": inertia,
        "period": float(draw.rng.uniform(6.0, 12.0)),
    }


def build_spindle(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """Gyroscopic torque. Forms: "steady" speed, "surging" (it rises and falls by half; the reaction is felt, too)."""
    top = parameters["momentum"] / parameters["inertia"]
    swing = 0.5 if form == "surging" else 0.0

    def speed(t: Floats) -> Floats:
        return top * (1 + swing * np.sin(2 * np.pi * t / parameters["period"]))

    rotor = Rotor(np.array(parameters["axis"]), parameters["inertia"], speed)
    return Effect("spindle", form, parameters, world=lambda world: replace(world, rotor=rotor))


def spindle_coefficients(form: str, parameters: Parameters) -> dict[str, list[float]]:
    """Angular momentum, sensor axes; its mean where it surges."""
    return {"Nm_per_rad_s": vector(parameters["momentum"] * np.array(parameters["axis"]))}


def draw_eddy_brake(form: str, draw: Draw, scene: Scene) -> Parameters:
    """A conducting tool that turns in a magnetic field, or in a thick liquid."""
    return {"damping": 0.05 * draw.scale}


def build_eddy_brake(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """A torque against the angular velocity. Forms: "linear" (Nm s/rad), "square" (Nm s^2/rad^2)."""

    def couple(path: ToolPath) -> Floats:
        omega = path.angular_velocity()
        speed = np.linalg.norm(omega, axis=1, keepdims=True) if form == "square" else 1.0
        return -parameters["damping"] * speed * omega

    return twisted("eddy_brake", form, parameters, couple)


def eddy_brake_coefficients(form: str, parameters: Parameters) -> dict[str, float]:
    """Against the angular velocity."""
    return {"Nm_per_rad_s" if form == "linear" else "Nm_per_rad_s2": parameters["damping"]}


def draw_entrained(form: str, draw: Draw, scene: Scene) -> Parameters:
    """Water or air that a broad tool carries along: it has inertia and no weight."""
    point = near(scene.belief.tool.com, draw)
    return {"mass": 0.5 * draw.scale, "normal": vector(draw.direction()), "point": vector(point)}


def build_entrained(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """A force against the acceleration of a point. Forms: "sphere", "plate" (only along its normal, tool axes)."""
    point, normal = np.array(parameters["point"]), np.array(parameters["normal"])

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        a = path.acceleration(point)
        if form == "plate":
            across = path.rotation @ normal
            a = (a * across).sum(1, keepdims=True) * across
        return -parameters["mass"] * a, path.points(point)

    return loaded("entrained", form, parameters, load)


def entrained_coefficients(form: str, parameters: Parameters) -> dict[str, float]:
    """Against the acceleration."""
    return {"N_per_m_s2": parameters["mass"]}


def draw_dangling(form: str, draw: Draw, scene: Scene) -> Parameters:
    """A part of the tool's mass hangs or slides."""
    hz = draw.rng.uniform(1.3, 2.2) if form == "pendulum" else draw.rng.uniform(1.5, 3.0)
    return {"share": min(0.25 * draw.scale, 0.75), "hz": float(hz), "zeta": float(draw.rng.uniform(0.03, 0.15))}


def build_dangling(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """Forms: "pendulum" (a half-filled bottle), "soft_mount" (on soft springs across the tool, balanced)."""
    kind = "pendulum" if form == "pendulum" else "lateral"
    part = Sprung(kind, parameters["share"], parameters["hz"], parameters["zeta"], counterbalanced=kind == "lateral")
    return Effect("dangling", form, parameters, world=lambda world: replace(world, sprung=part))


def dangling_coefficients(form: str, parameters: Parameters) -> dict[str, float]:
    """Natural frequency and damping."""
    return {"frequency": parameters["hz"], "damping_ratio": parameters["zeta"]}
