"""Pairs of labelled logs of one robot and one withheld effect in two motions, with the extra wrench."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ftbias_jax.io.atomic import write_atomic
from validation.generator.arms import Floats
from validation.generator.effects.effect import Draw, Effect, Scene
from validation.generator.kinds.kind import Kind, Parameters
from validation.generator.kinds.likeness import says_the_same
from validation.generator.kinds.plan import KINDS, Job, make_plan
from validation.generator.make import Limits, choose_timeline, run_jobs, write_labels, write_log
from validation.generator.recording import Timeline, gap_rms, in_sigmas, noiseless, random_scene

SECOND = "second"
"""Folder of the logs in another motion, in the folder of the set."""
EXTRA = "extra"
"""Folder, beside the logs, of the part of the labels that is given sample by sample."""
TRIES, NEAR = 6, 0.05
"""Number of scalings of an effect, and the relative error of its gap at which they stop."""


def noise_scale(effect: Effect, scene: Scene) -> Floats:
    """Factor (T, 6) by which the effect multiplies the noise."""
    return effect.noise(np.ones((len(scene.stamps), 6)))


def gap_sigmas(kind: Kind, effect: Effect, scene: Scene) -> float:
    """Gap in noise sigmas: of the extra wrench, or of the extra noise if the effect has no extra wrench."""
    if kind.drive == "noise":
        return float(np.sqrt((noise_scale(effect, scene) ** 2 - 1).mean()))
    return in_sigmas(scene, gap_rms(scene, [effect]))


def sized(job: Job, scene: Scene, seed: np.random.SeedSequence) -> Parameters:
    """Draw the parameters of an effect with the requested gap, or one as near as its physics allows."""
    kind, scale = KINDS[job.kind], 0.3
    for _ in range(TRIES):
        parameters = kind.draw(job.form, Draw(np.random.default_rng(seed), 1, scale), scene)
        gap = gap_sigmas(kind, kind.build(job.form, parameters, scene), scene)
        if abs(gap / job.gap_sigmas - 1) < NEAR:
            break
        scale *= float(np.clip(job.gap_sigmas / max(gap, 1e-12), 1e-3, 1e3))
    return parameters


def make_pair(index: int, job: Job, seed: int, limits: Limits, folder: Path) -> tuple[str, dict[str, dict[str, Any]]]:
    """Write the logs number ``index``, their setups and extra wrenches; returns their name and both labels."""
    seeds = np.random.SeedSequence([seed, 3, index]).spawn(12)
    rng = np.random.default_rng(seeds[0])
    kind = KINDS[job.kind]
    duration, rate = float(np.round(rng.uniform(*limits.durations), 1)), float(rng.choice(limits.rates))
    timeline = choose_timeline(kind.drive == "temperature", rate, limits.plain, rng)
    motions = [_motion(kind, rng) for _ in range(2)]
    first, second = (
        random_scene(motion, duration, rate, pace, [seeds[1], *own])
        for (motion, pace), own in zip(motions, (seeds[2:5], seeds[5:8]), strict=True)
    )
    parameters = sized(job, first, seeds[8])
    name = f"log_{index:03d}"
    labels = {}
    for place, scene, (motion, _), noise in (
        ("", first, motions[0], seeds[9]),
        (SECOND, second, motions[1], seeds[10]),
    ):
        effect = kind.build(job.form, parameters, scene)
        labels[place] = _write(folder / place, name, kind, effect, scene, timeline, noise) | {"kind": motion}
    return name, labels


def _motion(kind: Kind, rng: np.random.Generator) -> tuple[str, float]:
    """Draw the kind of motion and its pace; brisk if the effect needs motion to show."""
    if kind.brisk:
        return str(rng.choice(["sines", "moves", "trapezoids"])), rng.uniform(1.2, 1.8)
    return str(rng.choice(["sines", "moves", "trapezoids", "scan"], p=[0.3, 0.3, 0.25, 0.15])), rng.uniform(0.7, 1.4)


def _write(
    folder: Path,
    name: str,
    kind: Kind,
    effect: Effect,
    scene: Scene,
    timeline: Timeline,
    seed: np.random.SeedSequence,
) -> dict[str, Any]:
    """Write one log, its setup and its extra wrench; returns its label."""
    label, clean, noise_rms = write_log(folder, name, scene, [effect], timeline, seed)
    sign = -1.0 if scene.belief.reports == "wrench_on_sensor" else 1.0
    bare = noiseless(scene, ()).wrench
    extra = sign * (clean.wrench - bare)
    std = scene.belief.noise_std * noise_scale(effect, scene)
    hidden = {"t": scene.stamps, "wrench": extra, "noise_std": std}
    write_atomic(folder / EXTRA / f"{name}.npz", lambda file: np.savez_compressed(file, **hidden))  # type: ignore[arg-type]
    gap = gap_sigmas(kind, effect, scene)
    return label | {
        "level": 1,
        "gap_sigmas": gap,
        "term": {
            "drive": kind.drive,
            "equivalent": equivalents(kind, effect, clean.wrench - bare, scene),
            "catalogue_twins": list(kind.twins),
            "frame": kind.frame,
            "acts_as": kind.acts_as,
            "coefficients": kind.coefficients(effect.form, effect.parameters),
            "unseen": kind.unseen,
            "oracle_shrink": None if kind.drive == "noise" else oracle_shrink(gap, noise_rms, scene.belief.noise_std),
        },
    }


def equivalents(kind: Kind, effect: Effect, extra: Floats, scene: Scene) -> list[str]:
    """Drives that are equivalent for this effect in this motion; extra: extra wrench (T, 6) N, Nm at the stamps."""
    always = kind.equivalent + kind.equivalent_forms.get(effect.form, ())
    return [*always, *(drive for drive in kind.sometimes if says_the_same(drive, extra, scene))]


def oracle_shrink(gap: float, noise_rms: Floats, noise_std: Floats) -> float:
    """Shrink of an oracle that subtracts the extra wrench exactly: 1, unless the noise is not as large as stated."""
    after = float(((noise_rms / noise_std) ** 2).mean()) - 1
    return float(np.clip(1 - after / (after + gap**2), 0, 1)) if after + gap**2 > 0 else 1.0


def make_set(
    folder: Path,
    which: str,
    count: int,
    seed: int,
    limits: Limits,
    jobs: int = 1,
    report: Callable[[int], None] = lambda done: None,
) -> None:
    """Write logs of withheld kinds with setups, labels and extra wrenches, and a second log for each in ``SECOND``.

    Args:
        folder: an existing folder.
        which: "seen", "unseen", "all" or "events", the kinds.
        count: number of pairs of logs.
        seed: the same seed makes the same logs, whatever ``jobs`` is.
        limits: durations, rates, streams.
        jobs: number of processes.
        report: called with the number of pairs that are finished.
    """
    for extra in (folder / EXTRA, folder / SECOND / EXTRA):
        extra.mkdir(parents=True)
    make = partial(make_pair, seed=seed, limits=limits, folder=folder)
    made = run_jobs(make, make_plan(which, count, seed), jobs, report)
    for place in (SECOND, ""):
        write_labels(folder / place, {name: labels[place] for name, labels in made})
