"""Causes that follow time or temperature."""

from __future__ import annotations

import numpy as np

from validation.generator.arms import Floats
from validation.generator.effects.effect import Draw, Effect, Scene, uneven
from validation.generator.effects.sensing import GAIN
from validation.generator.effects.slow import lagged
from validation.generator.kinds.kind import Parameters, loaded, near, vector
from validation.generator.world import ToolPath

REFERENCE = 25.0  # deg C at which the gauges were calibrated


def draw_dispenser(form: str, draw: Draw, scene: Scene) -> Parameters:
    """A glue cartridge on the tool becomes empty."""
    return {
        "loss": 0.1 * draw.scale,
        "tau": float(draw.rng.uniform(0.2, 0.4) * scene.duration),
        "point": vector(near(scene.belief.tool.com, draw, 0.08)),
    }


def build_dispenser(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """Mass that leaves, kg in 30 s or in all. Forms: "steady", "emptying" (an exponential)."""
    point = np.array(parameters["point"])

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        t = np.maximum(path.t, 0.0)
        gone = parameters["loss"] * (t / 30.0 if form == "steady" else 1 - np.exp(-t / parameters["tau"]))
        return -gone[:, None] * (scene.belief.gravity - path.acceleration(point)), path.points(point)

    return loaded("dispenser", form, parameters, load)


def dispenser_coefficients(form: str, parameters: Parameters) -> dict[str, float]:
    """Loss in a second."""
    return {"kg_per_s": parameters["loss"] / 30.0} if form == "steady" else {}


def draw_regulator(form: str, draw: Draw, scene: Scene) -> Parameters:
    """A pressure regulator that hunts: slow swings of the bias."""
    return {"amplitude": vector(uneven(draw, draw.scale)), "period": float(draw.rng.uniform(4.0, 9.0))}


def build_regulator(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """A bias that repeats. Forms: "sine", "triangle"."""
    amplitude = np.array(parameters["amplitude"])

    def slow(t: Floats) -> Floats:
        wave = np.sin(2 * np.pi * t / parameters["period"])
        return (wave if form == "sine" else 2 / np.pi * np.arcsin(wave))[:, None] * amplitude

    return Effect("regulator", form, parameters, slow=slow)


def draw_warm_side(form: str, draw: Draw, scene: Scene) -> Parameters:
    """Heat reaches one side of the sensor first."""
    return {"per_kelvin": vector(uneven(draw, draw.scale)), "tau": float(draw.rng.uniform(2.0, 5.0))}


def build_warm_side(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """A bias that follows the temperature. Forms: "gradient" (how fast it changes), "square" (off 25 deg C)."""
    per_kelvin = np.array(parameters["per_kelvin"])

    def slow(t: Floats) -> Floats:
        kelvin = scene.temperature(t)
        course = kelvin - lagged(t, kelvin, parameters["tau"]) if form == "gradient" else (kelvin - REFERENCE) ** 2 / 10
        return course[:, None] * per_kelvin

    return Effect("warm_side", form, parameters, slow=slow)


def draw_warm_gauge(form: str, draw: Draw, scene: Scene) -> Parameters:
    """Gauges whose sensitivity depends on the temperature: share a kelvin."""
    return {"per_kelvin": vector(0.02 * draw.scale * draw.signs() * draw.rng.uniform(0.4, 1.0, 6))}


def build_warm_gauge(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """Forms: "linear", "square" (off 25 deg C)."""
    kelvin = scene.temperature(scene.grid) - REFERENCE
    course = kelvin if form == "linear" else kelvin**2 / 10
    factor = 1 + course[:, None] * np.array(parameters["per_kelvin"])
    return Effect("warm_gauge", form, parameters, sensor=lambda w: w * factor, order=GAIN)


def warm_gauge_coefficients(form: str, parameters: Parameters) -> dict[str, list[float]]:
    """Change of every channel's gain a kelvin."""
    return {"per_K": parameters["per_kelvin"]} if form == "linear" else {}
