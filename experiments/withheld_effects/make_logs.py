#!/usr/bin/env python3
"""Labelled logs by MuJoCo, for checking a diagnosis on effects and functional forms it was not built with.

    python make_logs.py OUT --count 128 --seed 1 [--effects all] [--duration 20,60] [--rate 125,250,500] [--jobs 2]

writes OUT/log_NNN.npz (what a user has), OUT/log_NNN.toml (what the user believes) and OUT/truth.json (for the scorer).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from arms import Floats
from believed import setup_toml
from catalogue import ENTRIES, NEEDS_MOTION, STATISTICAL, UNLISTED
from effect import Draw, Effect, Scene
from plan import Job, groups, make_plan
from recording import Reading, Timeline, gap_rms, in_sigmas, random_scene, record

SMALLEST, LARGEST = 0.4, 20.0  # noise sigmas: gaps outside are drawn again with another scale
SMALLEST_UNLISTED = 0.7


@dataclass(frozen=True)
class Limits:
    """What the command line leaves to chance."""

    durations: tuple[float, float]
    """s, shortest and longest."""
    rates: tuple[float, ...]
    """Hz."""
    plain: bool
    """Joints and wrench always share their stamps, and velocities are always there."""


def choose_motion(job: Job, rng: np.random.Generator) -> tuple[str, float]:
    """Kind of motion and its pace; brisk where the effect would not show otherwise."""
    if "tool_flexibility" in job.names:
        return str(rng.choice(["moves", "trapezoids"])), rng.uniform(1.4, 1.9)
    if set(job.names) & set(NEEDS_MOTION):
        return str(rng.choice(["sines", "moves", "trapezoids"])), rng.uniform(1.2, 1.8)
    return str(rng.choice(["sines", "moves", "trapezoids", "scan"], p=[0.3, 0.3, 0.25, 0.15])), rng.uniform(0.7, 1.4)


def choose_timeline(job: Job, rate: float, plain: bool, rng: np.random.Generator) -> Timeline:
    """Streams on one clock mostly; a temperature is there when it is the cause, and often when it is not."""
    own_clock, velocities = rng.uniform() < 0.2, rng.uniform() > 0.12
    joint_rate = float(rng.choice([100.0, 125.0, 200.0, 250.0, 500.0]))
    recorded = rng.uniform() < 0.3 or "temperature_drift" in job.names
    every = int(rng.choice([1, max(1, round(rate / 5))])) if recorded else 0
    if plain:
        return Timeline(None, True, every)
    return Timeline(joint_rate if own_clock else None, velocities, every)


def sized_effect(name: str, form: str, level: int, scene: Scene, seed: np.random.SeedSequence) -> tuple[Effect, float]:
    """The effect and its gap in noise sigmas, its size scaled until the gap is neither invisible nor absurd."""
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
    """Write log and setup number ``index``; its name and its entry in truth.json."""
    seeds = np.random.SeedSequence([seed, 1, index]).spawn(8)
    rng = np.random.default_rng(seeds[0])
    duration, rate = float(np.round(rng.uniform(*limits.durations), 1)), float(rng.choice(limits.rates))
    kind, pace = choose_motion(job, rng)
    timeline = choose_timeline(job, rate, limits.plain, rng)
    scene = random_scene(kind, duration, rate, pace, seeds[1:5])
    sized = [
        sized_effect(name, form, job.level, scene, one)
        for name, form, one in zip(job.names, job.forms, seeds[5].spawn(len(job.names)), strict=True)
    ]
    effects = [effect for effect, _ in sized]
    columns, clean, noise_rms = record(scene, effects, timeline, seeds[6])
    name = f"log_{index:03d}"
    np.savez_compressed(folder / f"{name}.npz", **columns)
    (folder / f"{name}.toml").write_text(setup_toml(scene.belief))
    each = {effect.name: gap for effect, gap in sized}
    return name, truth(scene, effects, job.level, kind, clean, noise_rms) | {
        "gap_sigmas_each": each,
        "timeline": "one clock" if timeline.joint_rate is None else f"joints at {timeline.joint_rate:g} Hz",
        "velocities": timeline.velocities,
        "temperature": bool(timeline.temperature_every),
    }


def truth(
    scene: Scene, effects: Sequence[Effect], level: int, kind: str, clean: Reading, noise_rms: Floats
) -> dict[str, Any]:
    """A log's label: the structure of shared/data/gap_dev, and what else a scorer may want."""
    rms = gap_rms(scene, effects)
    seconds = (np.arange(int(scene.duration)) * scene.rate).round().astype(int)
    return {
        "effects": {effect.name: effect.parameters for effect in effects} or {"none": {}},
        "form": {effect.name: effect.form for effect in effects},
        "level": level,
        "kind": kind,
        "duration": scene.duration,
        "rate": scene.rate,
        "robot": scene.belief.arm.name,
        "reports": scene.belief.reports,
        "sigma": scene.belief.noise_std.tolist(),
        "noise_floor": noise_rms.tolist(),
        "gap_rms": rms.tolist(),
        "gap_sigmas": in_sigmas(scene, rms),
        "bias_1hz": clean.bias[seconds].round(6).tolist(),
    }


def numbers(text: str) -> tuple[float, ...]:
    """Comma-separated positive numbers."""
    values = tuple(float(value) for value in text.split(","))
    if not all(value > 0 for value in values):
        raise argparse.ArgumentTypeError(f"expected positive numbers, got {text!r}")
    return values


def effect_names(text: str) -> str:
    """The text, once every name in it is known."""
    try:
        groups(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return text


def parse(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, metavar="OUT", help="folder to write, made if need be")
    parser.add_argument("--count", type=int, default=128, help="logs (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="the same seed makes the same logs")
    parser.add_argument(
        "--effects", type=effect_names, default="all", help="all, catalogue, none, pairs, unlisted or names, by commas"
    )
    parser.add_argument("--duration", type=numbers, default=(20.0, 60.0), help="s: one value, or shortest,longest")
    parser.add_argument("--rate", type=numbers, default=(125.0, 200.0, 250.0, 400.0, 500.0), help="Hz, to choose from")
    parser.add_argument("--plain", action="store_true", help="one clock and all velocities in every log")
    parser.add_argument("--jobs", type=int, default=1, help="processes (default: %(default)s)")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the logs of one folder."""
    args = parse(arguments)
    jobs = make_plan(args.effects, args.count, args.seed)
    args.out.mkdir(parents=True, exist_ok=True)
    limits = Limits((args.duration[0], args.duration[-1]), args.rate, args.plain)
    make = partial(make_log, seed=args.seed, limits=limits, folder=args.out)
    with ProcessPoolExecutor(args.jobs) as pool:
        labels = dict(pool.map(make, range(len(jobs)), jobs))
    (args.out / "truth.json").write_text(json.dumps(labels, indent=1))
    print(f"{len(labels)} logs in {args.out}")


if __name__ == "__main__":
    main()
