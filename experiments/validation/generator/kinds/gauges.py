"""Errors of the gauges that depend on load, on load and time, on a frequency, or that affect the noise."""

from __future__ import annotations

from typing import Any

import numpy as np

from validation.generator.arms import Floats
from validation.generator.effects.effect import Draw, Scene
from validation.generator.effects.sensing import BENT, GAIN
from validation.generator.kinds.kind import Hooks, Kind, between, directed, near_com, of_duration, pushed, shares, times
from validation.generator.world import ToolPath


def soft_gauge(form: str, p: Any, scene: Scene) -> Hooks:
    """Nonlinear gauges, each channel separately; ``share``: relative error at the largest load of the log."""
    power = 2 if form == "cubic" else 1
    return {"sensor": lambda w: w + p.share * w * (np.abs(w) / p.load) ** power, "order": BENT}


def lopsided(form: str, p: Any, scene: Scene) -> Hooks:
    """Gauges with different gains for pull and push (a kink at zero load), or with a dead zone for small loads."""

    def sensor(w: Floats) -> Floats:
        return w + p.share * np.maximum(w, 0) if form == "pull_and_push" else w - p.zone * np.tanh(w / p.zone)

    return {"sensor": sensor, "order": BENT}


def ageing(form: str, p: Any, scene: Scene) -> Hooks:
    """Gauges that lose sensitivity, each at a separate rate; ``share``: share of the reading per 30 s, or in total."""
    t = np.maximum(scene.grid, 0.0)
    course = t / 30.0 if form == "linear" else 1 - np.exp(-t / p.tau)
    factor = 1 + course[:, None] * p.share
    return {"sensor": lambda w: w * factor, "order": GAIN}


def supply(form: str, p: Any, scene: Scene) -> Hooks:
    """Sagging voltage of the bridges, by one share for all channels: within half a second, or in a slow wave."""
    t = scene.grid
    step = 0.5 + 0.5 * np.tanh((t - p.time) / 0.2)
    course = step if form == "step" else np.sin(2 * np.pi * t / p.period)
    factor = 1 + p.share * course[:, None]
    return {"sensor": lambda w: w * factor, "order": GAIN}


def hum(form: str, p: Any, scene: Scene) -> Hooks:
    """Mains hum of the amplifier: a sine with a separate phase per channel, alone or with 40 % third harmonic."""

    def slow(t: Floats) -> Floats:
        angle = 2 * np.pi * p.hz * t[:, None] + p.phase
        return p.amplitude * (np.sin(angle) + 0.4 * np.sin(3 * angle) * (form == "third_harmonic"))

    return {"slow": slow}


def pump(form: str, p: Any, scene: Scene) -> Hooks:
    """Pump that shakes a hose on the tool along one direction of the base frame: a sine, or nearly square strokes."""

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        wave = np.sin(2 * np.pi * p.hz * path.t + p.phase)
        wave = np.tanh(2.5 * wave) if form == "strokes" else wave
        return wave[:, None] * p.force, path.points(p.point)

    return pushed(load)


def rough_bridge(form: str, p: Any, scene: Scene) -> Hooks:
    """Bad contact: noise that grows with each channel's load or with the force; ``growth``: sigmas at the rms load."""
    load = np.stack([np.interp(scene.stamps, scene.grid, w) for w in scene.nominal.T], 1)
    if form == "force":
        load = np.repeat(np.linalg.norm(load[:, :3], axis=1, keepdims=True), 6, axis=1)
    size = np.abs(load) / np.sqrt((load**2).mean(0))
    scale = np.sqrt(1 + (p.growth * size) ** 2)
    return {"noise": lambda noise: noise * scale}


def radio(form: str, p: Any, scene: Scene) -> Hooks:
    """Nearby welder or radio: noise that comes in bursts or rises steadily."""
    t = scene.stamps[:, None]
    on = ((t > p.starts) & (t < p.starts + p.seconds)).any(1) if form == "spells" else t[:, 0] / 15.0
    scale = np.sqrt(1 + (2 * p.growth * on) ** 2)[:, None]
    return {"noise": lambda noise: noise * scale}


def _top(form: str, draw: Draw, scene: Scene) -> Floats:
    """Largest nominal load (6,) N, Nm of the log per channel."""
    return np.abs(scene.nominal).max(0)


def _by_unit(values: Floats, words: str) -> dict[str, Floats]:
    """Split six numbers into forces and torques; UNIT in ``words`` becomes N or Nm."""
    return {words.replace("UNIT", unit): own for unit, own in (("N", values[:3]), ("Nm", values[3:]))}


def _of_gauge(form: str, p: Any) -> dict[str, Floats]:
    power = 2 if form == "cubic" else 1
    return _by_unit(p.share / p.load**power, f"UNIT_per_UNIT{power + 1}")


GAUGES = (
    Kind(
        *("soft_gauge", "load", "sensor", "wrench", ("cubic", "quadratic")),
        {"share": shares(0.04, 0.3), "load": _top},
        soft_gauge,
        known=_of_gauge,
        sometimes=("orientation",),
    ),
    Kind(
        *("lopsided", "load", "sensor", "wrench", ("pull_and_push", "dead_zone")),
        {
            "share": shares(0.05, 0.3),
            "zone": lambda form, draw, scene: 0.05 * draw.scale * _top(form, draw, scene),
        },
        lopsided,
        unseen=True,
        sometimes=("orientation",),
    ),
    Kind(
        *("ageing", "load_time", "sensor", "wrench", ("linear", "settling")),
        {"share": shares(0.04, 0.4), "tau": of_duration(0.15, 0.35)},
        ageing,
        known=lambda form, p: _by_unit(p.share / 30.0, "UNIT_per_UNIT_s") if form == "linear" else {},
    ),
    Kind(
        *("supply", "load_time", "sensor", "wrench", ("step", "wave")),
        {
            "share": lambda form, draw, scene: 0.05 * draw.scale * draw.sign(),
            "time": of_duration(0.3, 0.7),
            "period": of_duration(0.3, 0.6),
        },
        supply,
        unseen=True,
        equivalent=("time",),
    ),
    Kind(
        *("hum", "frequency", "sensor", "bias", ("sine", "third_harmonic")),
        {
            "amplitude": lambda form, draw, scene: draw.scale * draw.rng.uniform(0.4, 1.2, 6) * scene.belief.noise_std,
            "hz": lambda form, draw, scene: (
                float(draw.rng.choice([50.0, 60.0])) * (1 + float(draw.rng.normal(0, 2e-4)))
            ),
            "phase": lambda form, draw, scene: draw.rng.uniform(0, 2 * np.pi, 6),
        },
        hum,
        known=lambda form, p: {"frequency": p.hz},
    ),
    Kind(
        *("pump", "frequency", "base", "force", ("sine", "strokes")),
        {"force": directed(1.0), "hz": between(8.0, 28.0), "phase": between(0, 2 * np.pi), "point": near_com()},
        pump,
        known=lambda form, p: {"frequency": p.hz},
        unseen=True,
    ),
    Kind(
        *("rough_bridge", "noise", "sensor", "noise", ("each_channel", "force")),
        {"growth": times(1.0)},
        rough_bridge,
    ),
    Kind(
        *("radio", "noise", "sensor", "noise", ("spells", "rising")),
        {
            "starts": lambda form, draw, scene: np.sort(draw.rng.uniform(0.0, 0.85, 3)) * scene.duration,
            "growth": times(1.0),
            "seconds": lambda form, draw, scene: draw.rng.uniform(1.5, 4.0, 3),
        },
        radio,
        unseen=True,
    ),
)
