"""One robot's logs over sixty days, simulated by MuJoCo instead of the package; an effect begins on one of the days."""

import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.append(str(Path(__file__).parents[1]))
import ftbias_jax as ft
from validation.generator.effects.catalogue import ENTRIES
from validation.generator.effects.effect import Draw, Scene
from validation.generator.effects.slow import bias_path
from validation.generator.motion import random_motion
from validation.generator.nominal_model import random_belief, setup_toml
from validation.generator.recording import Timeline, gap_rms, in_sigmas, record
from validation.generator.world import nominal_world, time_grid, wrench

DAYS, DURATION, RATE = 60, 12.0, 250.0
"""Number of days with one log each; s and Hz of a log."""
FIRST = 1_767_600_000.0
"""s since 1970, 2026-01-05."""
AGEING = {"gain": "scattered", "mount_rotation": "sensor_and_tool", "crosstalk": "sparse"}
"""Effects that grow from a day on -> the form that the generator makes of them."""
REFITS = {"cable": "forearm", "tool_mass": "point_at_com", "tool_com": "any_direction", "encoder_offset": "constant"}
"""Effects that begin at full size -> the form that the generator makes of them."""
LARGEST_GAP = (0.15, 1.0)
"""Range of the gap on the last day, in noise sigmas; a single log is enough to show the larger gaps."""
BY_DAY = 0.15
"""Standard deviation of the relative variation of the effect by day."""


class History(NamedTuple):
    """One robot's logs, and the effect that they contain."""

    setup: ft.Setup
    logs: list
    cause: str
    """"" = healthy."""
    day: int
    """First day with the cause."""
    grows: bool
    gap: float
    """Gap on the last day, in noise sigmas."""


def history(seed, healthy):
    """Simulate sixty logs of one robot."""
    rng = np.random.default_rng([seed, 0])
    belief = replace(random_belief(rng), reports="wrench_on_tool")
    setup = ft.parse_setup(tomllib.loads(setup_toml(belief)))
    world, grid = nominal_world(belief), time_grid(DURATION)
    scenes = [_scene(belief, world, grid, seed, day) for day in range(DAYS)]
    names = list(AGEING | REFITS)
    name = "" if healthy else names[seed % len(names)]
    begins, share = int(rng.integers(10, 50)), np.zeros(DAYS)
    if name:
        since = np.arange(DAYS) - begins
        share = np.where(since < 0, 0.0, (since + 1) / (DAYS - begins) if name in AGEING else 1.0)
        share *= 1 + BY_DAY * rng.normal(size=DAYS)
    wanted = float(np.exp(rng.uniform(*np.log(LARGEST_GAP))))
    scale = _scale(name, scenes[-1], seed, wanted) if name else 0.0
    logs = []
    for day, (scene, part) in enumerate(zip(scenes, share, strict=True)):
        effects = [_effect(name, scene, seed, float(scale * part))] if part else []
        columns, _, _ = record(scene, effects, Timeline(None, True, 0), np.random.SeedSequence([seed, 2, day]))
        stamps = FIRST + 86400.0 * day + columns["t"]
        logs.append(ft.Log.from_arrays(setup, stamps, columns["q"], columns["wrench"], columns["dq"]))
    return History(setup, logs, name, begins, name in AGEING, wanted if name else 0.0)


def _scene(belief, world, grid, seed, day):
    """Random motion and bias of a day."""
    rng = np.random.default_rng([seed, 1, day])
    kind, stamps = str(rng.choice(["sines", "moves", "trapezoids"])), np.arange(round(DURATION * RATE)) / RATE
    motion = random_motion(kind, belief.arm, DURATION, rng.uniform(0.7, 1.4), rng)
    bias = bias_path(stamps, belief.bias_density, rng)
    return Scene(
        belief, motion, DURATION, RATE, stamps, world, grid, wrench(world, motion, grid), bias, lambda t: 0 * t
    )


def _effect(name, scene, seed, scale):
    form = (AGEING | REFITS)[name]
    return ENTRIES[name][0](form, Draw(np.random.default_rng([seed, 3]), 1, scale), scene)


def _scale(name, scene, seed, wanted):
    """Scale with which the drawn effect makes the wanted gap, in noise sigmas."""
    scale = 1.0
    for _ in range(4):
        gap = in_sigmas(scene, gap_rms(scene, [_effect(name, scene, seed, scale)]))
        scale *= float(wanted / max(gap, 1e-9))
    return scale
