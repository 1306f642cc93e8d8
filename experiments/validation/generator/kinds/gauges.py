"""Errors of the gauges: with the load, with the load and time, at a frequency, in the noise."""

from __future__ import annotations

import numpy as np

from validation.generator.arms import Floats
from validation.generator.effects.effect import Draw, Effect, Scene
from validation.generator.effects.sensing import BENT, GAIN
from validation.generator.kinds.kind import Parameters, loaded, near, vector
from validation.generator.world import ToolPath


def draw_soft_gauge(form: str, draw: Draw, scene: Scene) -> Parameters:
    """Gauges that are not straight: share of the reading at the largest load of the log."""
    share = 0.04 * draw.scale * draw.signs() * draw.rng.uniform(0.3, 1.0, 6)
    return {"share": vector(share), "load": vector(np.abs(scene.nominal).max(0))}


def build_soft_gauge(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """Forms: "cubic" (W^3), "quadratic" (W |W|), channel by channel."""
    share, top = np.array(parameters["share"]), np.array(parameters["load"])
    power = 2 if form == "cubic" else 1
    bend = lambda w: w + share * w * (np.abs(w) / top) ** power  # noqa: E731
    return Effect("soft_gauge", form, parameters, sensor=bend, order=BENT)


def soft_gauge_coefficients(form: str, parameters: Parameters) -> dict[str, list[float]]:
    """Channel by channel, of the load's square or cube."""
    power = 2 if form == "cubic" else 1
    values = np.array(parameters["share"]) / np.array(parameters["load"]) ** power
    return {f"{unit}_per_{unit}{power + 1}": vector(own) for unit, own in _forces_and_torques(values)}


def _forces_and_torques(values: np.ndarray) -> tuple[tuple[str, np.ndarray], ...]:
    """Six numbers by their unit."""
    return ("N", values[:3]), ("Nm", values[3:])


def draw_lopsided(form: str, draw: Draw, scene: Scene) -> Parameters:
    """Gauges that read pull and push differently, or nothing of a small load."""
    share = 0.05 * draw.scale * draw.signs() * draw.rng.uniform(0.3, 1.0, 6)
    return {"share": vector(share), "zone": vector(0.05 * draw.scale * np.abs(scene.nominal).max(0))}


def build_lopsided(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """Forms: "pull_and_push" (a kink at zero load), "dead_zone" (small loads are lost in play)."""
    share, zone = np.array(parameters["share"]), np.array(parameters["zone"])

    def sensor(w: Floats) -> Floats:
        return w + share * np.maximum(w, 0) if form == "pull_and_push" else w - zone * np.tanh(w / zone)

    return Effect("lopsided", form, parameters, sensor=sensor, order=BENT)


def draw_ageing(form: str, draw: Draw, scene: Scene) -> Parameters:
    """Gauges that lose their sensitivity, each at its own rate: share of the reading in 30 s."""
    share = 0.04 * draw.scale * draw.signs() * draw.rng.uniform(0.4, 1.0, 6)
    return {"share": vector(share), "tau": float(draw.rng.uniform(0.15, 0.35) * scene.duration)}


def build_ageing(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """Sensitivity that changes with time. Forms: "linear", "settling" (an exponential)."""
    t = np.maximum(scene.grid, 0.0)
    course = t / 30.0 if form == "linear" else 1 - np.exp(-t / parameters["tau"])
    factor = 1 + course[:, None] * np.array(parameters["share"])
    return Effect("ageing", form, parameters, sensor=lambda w: w * factor, order=GAIN)


def ageing_coefficients(form: str, parameters: Parameters) -> dict[str, list[float]]:
    """Change of every channel's gain in a second."""
    if form != "linear":
        return {}
    values = np.array(parameters["share"]) / 30.0
    return {f"{unit}_per_{unit}_s": vector(own) for unit, own in _forces_and_torques(values)}


def draw_supply(form: str, draw: Draw, scene: Scene) -> Parameters:
    """The voltage of the bridges sags: the same share of every channel."""
    return {
        "share": 0.05 * draw.scale * draw.sign(),
        "time": float(draw.rng.uniform(0.3, 0.7) * scene.duration),
        "period": float(draw.rng.uniform(0.3, 0.6) * scene.duration),
    }


def build_supply(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """Sensitivity of all channels. Forms: "step" (within half a second), "wave" (slow)."""
    t = scene.grid
    step = 0.5 + 0.5 * np.tanh((t - parameters["time"]) / 0.2)
    course = step if form == "step" else np.sin(2 * np.pi * t / parameters["period"])
    factor = 1 + parameters["share"] * course[:, None]
    return Effect("supply", form, parameters, sensor=lambda w: w * factor, order=GAIN)


def draw_hum(form: str, draw: Draw, scene: Scene) -> Parameters:
    """The mains in the amplifier."""
    sizes = draw.scale * draw.rng.uniform(0.4, 1.2, 6) * scene.belief.noise_std
    mains = float(draw.rng.choice([50.0, 60.0])) * (1 + float(draw.rng.normal(0, 2e-4)))
    return {"amplitude": vector(sizes), "phase": vector(draw.rng.uniform(0, 2 * np.pi, 6)), "hz": mains}


def build_hum(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """A sine on every channel, its phase its own. Forms: "sine", "third_harmonic" (with 40 % of it)."""
    sizes, phase = np.array(parameters["amplitude"]), np.array(parameters["phase"])

    def slow(t: Floats) -> Floats:
        angle = 2 * np.pi * parameters["hz"] * t[:, None] + phase
        return sizes * (np.sin(angle) + 0.4 * np.sin(3 * angle) * (form == "third_harmonic"))

    return Effect("hum", form, parameters, slow=slow)


def draw_pump(form: str, draw: Draw, scene: Scene) -> Parameters:
    """A pump shakes a hose on the tool."""
    return {
        "force": vector(draw.scale * draw.direction()),
        "hz": float(draw.rng.uniform(8.0, 28.0)),
        "phase": float(draw.rng.uniform(0, 2 * np.pi)),
        "point": vector(near(scene.belief.tool.com, draw)),
    }


def build_pump(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """A force along one direction of the base, at a fixed frequency. Forms: "sine", "strokes" (nearly a square)."""
    force, point = np.array(parameters["force"]), np.array(parameters["point"])

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        wave = np.sin(2 * np.pi * parameters["hz"] * path.t + parameters["phase"])
        wave = np.tanh(2.5 * wave) if form == "strokes" else wave
        return wave[:, None] * force, path.points(point)

    return loaded("pump", form, parameters, load)


def line_coefficients(form: str, parameters: Parameters) -> dict[str, float]:
    """The frequency."""
    return {"frequency": parameters["hz"]}


def draw_rough_bridge(form: str, draw: Draw, scene: Scene) -> Parameters:
    """A bad contact: noise that grows with the load, in noise sigmas at the rms load."""
    return {"growth": draw.scale}


def build_rough_bridge(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """Forms: "each_channel" (with its own load), "force" (all with the size of the force)."""
    load = np.stack([np.interp(scene.stamps, scene.grid, w) for w in scene.nominal.T], 1)
    if form == "force":
        load = np.repeat(np.linalg.norm(load[:, :3], axis=1, keepdims=True), 6, axis=1)
    size = np.abs(load) / np.sqrt((load**2).mean(0))
    scale = np.sqrt(1 + (parameters["growth"] * size) ** 2)
    return Effect("rough_bridge", form, parameters, noise=lambda noise: noise * scale)


def draw_radio(form: str, draw: Draw, scene: Scene) -> Parameters:
    """A welder or a radio next door."""
    starts = np.sort(draw.rng.uniform(0.0, 0.85, 3)) * scene.duration
    return {"growth": draw.scale, "starts": vector(starts), "seconds": vector(draw.rng.uniform(1.5, 4.0, 3))}


def build_radio(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """Noise that changes with time. Forms: "spells" (on and off), "rising" (steadily)."""
    t = scene.stamps[:, None]
    starts, seconds = np.array(parameters["starts"]), np.array(parameters["seconds"])
    on = ((t > starts) & (t < starts + seconds)).any(1) if form == "spells" else t[:, 0] / 15.0
    scale = np.sqrt(1 + (2 * parameters["growth"] * on) ** 2)[:, None]
    return Effect("radio", form, parameters, noise=lambda noise: noise * scale)
