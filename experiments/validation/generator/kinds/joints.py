"""What the joints do to a sensor behind them: periodic errors, twisted bundles, seals, heat."""

from __future__ import annotations

import numpy as np

from validation.generator.arms import Floats
from validation.generator.effects.effect import Draw, Effect, Scene, uneven
from validation.generator.effects.sensing import RIPPLE
from validation.generator.effects.slow import lagged
from validation.generator.kinds.kind import Parameters, last_axis, twisted, vector
from validation.generator.world import ToolPath


def draw_cogging(form: str, draw: Draw, scene: Scene) -> Parameters:
    """The flexible gear of one joint pulls at the sensor as often as its teeth pass."""
    parameters = {
        "joint": int(draw.rng.integers(2, len(scene.belief.arm.home))) + 1,
        "per_turn": int(draw.rng.integers(4, 25)),
        "cosine": vector(uneven(draw, draw.scale)),
        "sine": vector(uneven(draw, draw.scale)),
    }
    return parameters


def build_cogging(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """A wrench in sensor axes, periodic in a joint's angle. Forms: "one_harmonic", "two_harmonics" (also twice it)."""
    angle = parameters["per_turn"] * scene.motion(scene.grid)[0][:, parameters["joint"] - 1, None]
    cosine, sine = np.array(parameters["cosine"]), np.array(parameters["sine"])
    wave = cosine * np.cos(angle) + sine * np.sin(angle)
    if form == "two_harmonics":
        wave = wave + 0.6 * (sine * np.cos(2 * angle) - cosine * np.sin(2 * angle))
    return Effect("cogging", form, parameters, sensor=lambda w: w + wave, order=RIPPLE)


def cogging_coefficients(form: str, parameters: Parameters) -> dict[str, float]:
    """Periods a turn."""
    return {"multiple": parameters["per_turn"]}


def draw_bundle(form: str, draw: Draw, scene: Scene) -> Parameters:
    """Cables through the last joint, twisted with it."""
    relaxed = scene.belief.arm.home[-1] + draw.rng.uniform(-0.5, 0.5)
    return {"stiffness": 0.05 * draw.scale, "relaxed": float(relaxed), "joint": len(scene.belief.arm.home)}


def build_bundle(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """A torque about the last joint against its angle. Forms: "linear" (Nm/rad), "stiffening" (Nm/rad^3)."""
    axis = last_axis(scene.world)

    def couple(path: ToolPath) -> Floats:
        twist = scene.motion(path.t)[0][:, -1] - parameters["relaxed"]
        size = -parameters["stiffness"] * (twist if form == "linear" else twist**3)
        return size[:, None] * (path.rotation @ axis)

    return twisted("bundle", form, parameters, couple)


def bundle_coefficients(form: str, parameters: Parameters) -> dict[str, float]:
    """Along the axis of the joint, on the tool."""
    return {"Nm_per_rad" if form == "linear" else "Nm_per_rad3": -parameters["stiffness"]}


def draw_warm_motors(form: str, draw: Draw, scene: Scene) -> Parameters:
    """Motors warm the sensor as they work."""
    return {
        "amplitude": vector(uneven(draw, 2.0 * draw.scale)),
        "tau": float(draw.rng.uniform(4.0, 10.0)),
        "joint": int(draw.rng.integers(len(scene.belief.arm.home) - 3, len(scene.belief.arm.home))) + 1,
    }


def build_warm_motors(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """A bias that follows squared joint speeds, late: N, Nm per rad^2/s^2. Forms: "all_joints", "one_joint"."""
    amplitude = np.array(parameters["amplitude"])

    def slow(t: Floats) -> Floats:
        squared = scene.motion(t)[1] ** 2
        power = squared.sum(1) if form == "all_joints" else squared[:, parameters["joint"] - 1]
        return lagged(t, power, parameters["tau"])[:, None] * amplitude

    return Effect("warm_motors", form, parameters, slow=slow)


def draw_seal(form: str, draw: Draw, scene: Scene) -> Parameters:
    """A rotary feedthrough around the last joint whose housing does not turn."""
    return {"friction": 0.05 * draw.scale, "joint": len(scene.belief.arm.home)}


def build_seal(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """A torque about the last joint against its speed. Forms: "viscous" (Nm s/rad), "dry" (Nm)."""
    axis = last_axis(scene.world)

    def couple(path: ToolPath) -> Floats:
        speed = scene.motion(path.t)[1][:, -1]
        size = -parameters["friction"] * (speed if form == "viscous" else np.tanh(speed / 0.01))
        return size[:, None] * (path.rotation @ axis)

    return twisted("seal", form, parameters, couple)


def seal_coefficients(form: str, parameters: Parameters) -> dict[str, float]:
    """Against the speed."""
    return {"Nm_per_rad_s" if form == "viscous" else "Nm": parameters["friction"]}
