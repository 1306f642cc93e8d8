"""Causes that depend on time, temperature or the joints of the arm."""

from __future__ import annotations

from typing import Any

import numpy as np

from validation.generator.arms import Floats
from validation.generator.effects.effect import Draw, Scene
from validation.generator.effects.sensing import GAIN, RIPPLE
from validation.generator.effects.slow import lagged
from validation.generator.kinds.kind import (
    Hooks,
    Kind,
    Sampler,
    amplitudes,
    between,
    near_com,
    of_duration,
    pushed,
    shares,
    times,
)
from validation.generator.world import ToolPath

REFERENCE = 25.0  # deg C, calibration temperature of the gauges


def dispenser(form: str, p: Any, scene: Scene) -> Hooks:
    """Glue cartridge on the tool that empties: loss in kg per 30 s, or in total along an exponential."""

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        t = np.maximum(path.t, 0.0)
        gone = p.loss * (t / 30.0 if form == "steady" else 1 - np.exp(-t / p.tau))
        return -gone[:, None] * (scene.belief.gravity - path.acceleration(p.point)), path.points(p.point)

    return pushed(load)


def regulator(form: str, p: Any, scene: Scene) -> Hooks:
    """Pressure regulator that hunts: a periodic bias, N, Nm."""

    def slow(t: Floats) -> Floats:
        wave = np.sin(2 * np.pi * t / p.period)
        return (wave if form == "sine" else 2 / np.pi * np.arcsin(wave))[:, None] * p.amplitude

    return {"slow": slow}


def warm_side(form: str, p: Any, scene: Scene) -> Hooks:
    """Heat reaches one side first: a bias by temperature less its lagged value, or by its squared deviation."""

    def slow(t: Floats) -> Floats:
        kelvin = scene.temperature(t)
        course = kelvin - lagged(t, kelvin, p.tau) if form == "gradient" else (kelvin - REFERENCE) ** 2 / 10
        return course[:, None] * p.per_kelvin

    return {"slow": slow}


def warm_gauge(form: str, p: Any, scene: Scene) -> Hooks:
    """Temperature-dependent sensitivity of the gauges: share of the reading per K, or per 10 K^2."""
    kelvin = scene.temperature(scene.grid) - REFERENCE
    course = kelvin if form == "linear" else kelvin**2 / 10
    factor = 1 + course[:, None] * p.per_kelvin
    return {"sensor": lambda w: w * factor, "order": GAIN}


def cogging(form: str, p: Any, scene: Scene) -> Hooks:
    """Ripple of one joint's flexible gear: at its tooth-passing frequency, or also at twice that frequency."""
    angle = p.per_turn * scene.motion(scene.grid)[0][:, p.joint - 1, None]
    wave = p.cosine * np.cos(angle) + p.sine * np.sin(angle)
    if form == "two_harmonics":
        wave = wave + 0.6 * (p.sine * np.cos(2 * angle) - p.cosine * np.sin(2 * angle))
    return {"sensor": lambda w: w + wave, "order": RIPPLE}


def warm_motors(form: str, p: Any, scene: Scene) -> Hooks:
    """Bias that follows squared joint speeds with a lag: N, Nm per rad^2/s^2, of all joints or of one."""

    def slow(t: Floats) -> Floats:
        squared = scene.motion(t)[1] ** 2
        power = squared.sum(1) if form == "all_joints" else squared[:, p.joint - 1]
        return lagged(t, power, p.tau)[:, None] * p.amplitude

    return {"slow": slow}


def _joint(first: int) -> Sampler:
    """Sampler of a joint number from 1, after the first ``first`` joints; negative: among the last ones."""

    def sample(form: str, draw: Draw, scene: Scene) -> int:
        count = len(scene.belief.arm.home)
        return int(draw.rng.integers(first if first >= 0 else count + first, count)) + 1

    return sample


SLOW = (
    Kind(
        *("dispenser", "time", "base", "force", ("steady", "emptying")),
        {"loss": times(0.1), "tau": of_duration(0.2, 0.4), "point": near_com(0.08)},
        dispenser,
        known=lambda form, p: {"kg_per_s": p.loss / 30.0} if form == "steady" else {},
        equivalent=("load_time",),
    ),
    Kind(
        *("regulator", "time", "sensor", "bias", ("sine", "triangle")),
        {"amplitude": amplitudes(1.0), "period": between(4.0, 9.0)},
        regulator,
        unseen=True,
        equivalent=("frequency",),
    ),
    Kind(
        *("warm_side", "temperature", "sensor", "bias", ("gradient", "square")),
        {"per_kelvin": amplitudes(1.0), "tau": between(2.0, 5.0)},
        warm_side,
        twins=("temperature_drift",),
    ),
    Kind(
        *("warm_gauge", "temperature", "sensor", "wrench", ("linear", "square")),
        {"per_kelvin": shares(0.02, 0.4)},
        warm_gauge,
        known=lambda form, p: {"per_K": p.per_kelvin} if form == "linear" else {},
        unseen=True,
        equivalent=("load_time",),
    ),
    Kind(
        *("cogging", "joint_angle", "sensor", "wrench", ("one_harmonic", "two_harmonics")),
        {
            "joint": _joint(2),
            "per_turn": lambda form, draw, scene: int(draw.rng.integers(4, 25)),
            "cosine": amplitudes(1.0),
            "sine": amplitudes(1.0),
        },
        cogging,
        known=lambda form, p: {"multiple": p.per_turn},
        unseen=True,
    ),
    Kind(
        *("warm_motors", "joint_velocity", "sensor", "bias", ("all_joints", "one_joint")),
        {"amplitude": amplitudes(2.0), "tau": between(4.0, 10.0), "joint": _joint(-3)},
        warm_motors,
        unseen=True,
        brisk=True,
    ),
)
