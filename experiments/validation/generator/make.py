"""Labelled logs by MuJoCo: log_NNN.npz (a user's log), log_NNN.toml (the user's nominal setup) and truth.json."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ftbias_jax.errors import OutputError
from ftbias_jax.io.atomic import write_atomic
from ftbias_jax.runtime.executors import run_each
from validation.generator.arms import Floats
from validation.generator.effects.catalogue import ENTRIES, NEEDS_MOTION, STATISTICAL, UNLISTED
from validation.generator.effects.effect import Draw, Effect, Scene
from validation.generator.nominal_model import setup_toml
from validation.generator.plan import Job, make_plan
from validation.generator.recording import Reading, Timeline, gap_rms, in_sigmas, random_scene, record

Made = TypeVar("Made")

SMALLEST, LARGEST = 0.4, 20.0  # noise sigmas: effects with a gap outside are redrawn with another scale
SMALLEST_UNLISTED = 0.7


@dataclass(frozen=True)
class Limits:
    """Ranges and options of the random choices, from the command line."""

    durations: tuple[float, float]
    """s, shortest and longest."""
    rates: tuple[float, ...]
    """Hz."""
    plain: bool
    """Whether joints and wrench always share their stamps and velocities are always recorded."""


def choose_motion(job: Job, rng: np.random.Generator) -> tuple[str, float]:
    """Draw the kind of motion and its pace; brisk if the effect needs motion to show."""
    if "tool_flexibility" in job.names:
        return str(rng.choice(["moves", "trapezoids"])), rng.uniform(1.4, 1.9)
    if set(job.names) & set(NEEDS_MOTION):
        return str(rng.choice(["sines", "moves", "trapezoids"])), rng.uniform(1.2, 1.8)
    return str(rng.choice(["sines", "moves", "trapezoids", "scan"], p=[0.3, 0.3, 0.25, 0.15])), rng.uniform(0.7, 1.4)


def choose_timeline(thermal: bool, rate: float, plain: bool, rng: np.random.Generator) -> Timeline:
    """Draw the timeline, mostly of one clock; a temperature is always recorded if it is the cause (``thermal``)."""
    own_clock, velocities = rng.uniform() < 0.2, rng.uniform() > 0.12
    joint_rate = float(rng.choice([100.0, 125.0, 200.0, 250.0, 500.0]))
    recorded = rng.uniform() < 0.3 or thermal
    every = int(rng.choice([1, max(1, round(rate / 5))])) if recorded else 0
    if plain:
        return Timeline(None, True, every)
    return Timeline(joint_rate if own_clock else None, velocities, every)


def sized_effect(name: str, form: str, level: int, scene: Scene, seed: np.random.SeedSequence) -> tuple[Effect, float]:
    """Build an effect, scaled until its gap is neither invisible nor absurdly large; return it and the gap."""
    smallest = SMALLEST_UNLISTED if name in UNLISTED else SMALLEST
    scale = 1.0
    for _ in range(5):
        effect = ENTRIES[name][0](form, Draw(np.random.default_rng(seed), level, scale), scene)
        gap = in_sigmas(scene, gap_rms(scene, [effect]))
        if name in STATISTICAL or smallest <= gap <= LARGEST:
            break
        wanted = 1.5 * smallest if gap < smallest else 0.7 * LARGEST
        scale *= float(np.clip(wanted / max(gap, 1e-9), 0.2, 5.0))
    return effect, gap


def make_log(index: int, job: Job, seed: int, limits: Limits, folder: Path) -> tuple[str, dict[str, Any]]:
    """Write log and setup number ``index``; returns its name and its entry in truth.json."""
    seeds = np.random.SeedSequence([seed, 1, index]).spawn(8)
    rng = np.random.default_rng(seeds[0])
    duration, rate = float(np.round(rng.uniform(*limits.durations), 1)), float(rng.choice(limits.rates))
    kind, pace = choose_motion(job, rng)
    timeline = choose_timeline("temperature_drift" in job.names, rate, limits.plain, rng)
    scene = random_scene(kind, duration, rate, pace, seeds[1:5])
    sized = [
        sized_effect(name, form, job.level, scene, one)
        for name, form, one in zip(job.names, job.forms, seeds[5].spawn(len(job.names)), strict=True)
    ]
    effects = [effect for effect, _ in sized]
    name = f"log_{index:03d}"
    label, _, _ = write_log(folder, name, scene, effects, timeline, seeds[6])
    each = {effect.name: gap for effect, gap in sized}
    return name, label | {"level": job.level, "kind": kind, "gap_sigmas_each": each}


def write_log(
    folder: Path,
    name: str,
    scene: Scene,
    effects: Sequence[Effect],
    timeline: Timeline,
    seed: np.random.SeedSequence,
) -> tuple[dict[str, Any], Reading, Floats]:
    """Write a log and its setup.

    Returns:
        label (the applied effects and further data for a scorer), reading without noise, rms (6,) N, Nm of the noise.
    """
    columns, clean, noise_rms = record(scene, effects, timeline, seed)
    write_atomic(folder / f"{name}.npz", lambda file: np.savez_compressed(file, **columns))  # type: ignore[arg-type]
    write_atomic(folder / f"{name}.toml", lambda file: file.write(setup_toml(scene.belief).encode()))
    rms = gap_rms(scene, effects)
    seconds = (np.arange(int(scene.duration)) * scene.rate).round().astype(int)
    label = {
        "effects": {effect.name: effect.parameters for effect in effects} or {"none": {}},
        "form": {effect.name: effect.form for effect in effects},
        "duration": scene.duration,
        "rate": scene.rate,
        "robot": scene.belief.arm.name,
        "reports": scene.belief.reports,
        "sigma": scene.belief.noise_std.tolist(),
        "noise_floor": noise_rms.tolist(),
        "gap_rms": rms.tolist(),
        "gap_sigmas": in_sigmas(scene, rms),
        "bias_1hz": clean.bias[seconds].round(6).tolist(),
        "timeline": "one clock" if timeline.joint_rate is None else f"joints at {timeline.joint_rate:g} Hz",
        "velocities": timeline.velocities,
        "temperature": bool(timeline.temperature_every),
    }
    return label, clean, noise_rms


def make_set(
    folder: Path,
    asked: str,
    count: int,
    seed: int,
    limits: Limits,
    jobs: int = 1,
    report: Callable[[int], None] = lambda done: None,
) -> None:
    """Write a set of logs, their setups and, once all are written, truth.json.

    Args:
        folder: an existing folder.
        asked: effects, in the format of ``plan.groups``.
        count: number of logs.
        seed: the same seed makes the same logs, whatever ``jobs`` is.
        limits: durations, rates, streams.
        jobs: number of processes.
        report: called with the number of logs that are finished.

    Raises:
        ValueError: an effect is unknown. OutputError: a file cannot be written, or a process was killed.
    """
    plan = make_plan(asked, count, seed)
    labels = dict(run_jobs(partial(make_log, seed=seed, limits=limits, folder=folder), plan, jobs, report))
    write_labels(folder, labels)


def run_jobs(
    make: Callable[[int, Any], tuple[str, Made]],
    plan: Sequence[Any],
    jobs: int,
    report: Callable[[int], None],
) -> list[tuple[str, Made]]:
    """Call ``make`` for each number and job of the plan in several processes; returns the results in order.

    Raises:
        OutputError: a process was killed.
    """
    done: dict[int, tuple[str, Made]] = {}
    for (index, _), made in run_each(partial(_make_numbered, make), enumerate(plan), jobs):
        if made is None:
            remedy = "too little memory? give it more, or fewer --jobs"
            raise OutputError("its process was killed", field=f"log {index}", remedy=remedy)
        done[index] = made
        report(len(done))
    return [done[index] for index in range(len(plan))]


def _make_numbered(make: Callable[[int, Any], tuple[str, Made]], numbered: tuple[int, Any]) -> tuple[str, Made]:
    return make(*numbered)


def write_labels(folder: Path, labels: dict[str, Any]) -> None:
    """Write truth.json atomically: completely or not at all."""
    content = json.dumps(labels, indent=1).encode()
    write_atomic(folder / "truth.json", lambda file: file.write(content))
