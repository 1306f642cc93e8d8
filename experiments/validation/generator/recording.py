"""Conversion of a scene and its effects to the arrays of a log file, and the size of the effects' gap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from validation.generator.arms import Floats
from validation.generator.effects.effect import Effect, Scene
from validation.generator.effects.slow import bias_path, random_temperature
from validation.generator.motion import random_motion
from validation.generator.nominal_model import random_belief
from validation.generator.world import nominal_world, time_grid, wrench

THERMOMETER_STD = 0.02  # K


@dataclass(frozen=True)
class Reading:
    """Noise-free reading of the sensor at the scene's stamps, and the bias in it."""

    wrench: Floats
    """(T, 6) N, Nm, NaN = lost."""
    bias: Floats
    """(T, 6) N, Nm, including all slow effects."""


@dataclass(frozen=True)
class Timeline:
    """Clocks and streams of a log."""

    joint_rate: float | None
    """Hz of a joint stream with a separate clock; None: joints and wrench share their stamps."""
    velocities: bool
    """Whether joint velocities are recorded."""
    temperature_every: int
    """Rows from one recorded temperature to the next; 0: not recorded."""


def random_scene(
    kind: str, duration: float, rate: float, pace: float, seeds: Sequence[np.random.SeedSequence]
) -> Scene:
    """Draw a robot, a motion and a bias; ``seeds``: four, for the nominal model, motion, bias and temperature."""
    belief_rng, motion_rng, bias_rng, heat_rng = (np.random.default_rng(seed) for seed in seeds)
    belief = random_belief(belief_rng)
    motion = random_motion(kind, belief.arm, duration, pace, motion_rng)
    stamps = np.arange(round(duration * rate)) / rate
    world, grid = nominal_world(belief), time_grid(duration)
    return Scene(
        belief,
        motion,
        duration,
        rate,
        stamps,
        world,
        grid,
        wrench(world, motion, grid),
        bias_path(stamps, belief.bias_density, bias_rng),
        random_temperature(duration, heat_rng),
    )


def noiseless(scene: Scene, effects: Sequence[Effect]) -> Reading:
    """Reading at the scene's stamps with the effects, before noise and before the hooks that act on noisy values."""
    world = scene.world
    for effect in effects:
        world = effect.world(world)
    w = scene.nominal if world is scene.world else wrench(world, scene.motion, scene.grid)
    for effect in sorted(effects, key=lambda effect: effect.order):
        w = effect.sensor(w)
    times, bias = scene.stamps, scene.bias
    for effect in effects:
        times, bias = effect.clock(times), bias + effect.slow(scene.stamps)
    times = np.clip(times, scene.grid[0], scene.grid[-1])
    return Reading(CubicSpline(scene.grid, w)(times) - bias, bias)


def converted(readings: Floats, effects: Sequence[Effect]) -> Floats:
    """Return the readings (T, 6) N, Nm after the converter and transport."""
    for effect in effects:
        readings = effect.reading(readings)
    return readings


def gap_rms(scene: Scene, effects: Sequence[Effect]) -> Floats:
    """(6,) N, Nm: rms change of the noise-free reading by the effects, less a constant and a trend per axis."""
    change = converted(noiseless(scene, effects).wrench, effects) - noiseless(scene, ()).wrench
    seen = np.isfinite(change[:, 0])
    for effect in effects:
        seen &= effect.keep(scene.stamps)
    line = np.stack([np.ones(len(scene.stamps)), scene.stamps], 1)[seen]
    rest = change[seen] - line @ np.linalg.lstsq(line, change[seen], rcond=None)[0]
    return np.sqrt((rest**2).mean(0))


def in_sigmas(scene: Scene, rms: Floats) -> float:
    """Root mean square of rms / noise standard deviation over the six channels."""
    return float(np.sqrt(((rms / scene.belief.noise_std) ** 2).mean()))


def record(
    scene: Scene, effects: Sequence[Effect], timeline: Timeline, seed: np.random.SeedSequence
) -> tuple[dict[str, Floats], Reading, Floats]:
    """Return the columns of the log file, the noise-free reading, and the rms (6,) N, Nm of the noise added to it."""
    rng = np.random.default_rng(seed)
    clean = noiseless(scene, effects)
    noise = scene.belief.noise_std * rng.normal(size=clean.wrench.shape)
    for effect in effects:
        noise = effect.noise(noise)
    reading = converted(clean.wrench + noise, effects)
    keep = np.ones(len(scene.stamps), bool)
    for effect in effects:
        keep &= effect.keep(scene.stamps)
    if scene.belief.reports == "wrench_on_sensor":
        reading = -reading
    columns = _merged(scene, reading, keep, timeline, rng)
    return columns, clean, np.sqrt((noise**2).mean(0))


def _merged(
    scene: Scene, reading: Floats, keep: Floats, timeline: Timeline, rng: np.random.Generator
) -> dict[str, Floats]:
    """Merge the streams into columns on one timeline, NaN where a stream has no sample."""
    if timeline.joint_rate is None:
        t = scene.stamps[keep]
        columns = {"t": t, **_joints(scene, t, rng), "wrench": reading[keep]}
    else:
        offset = rng.uniform(0.1, 0.9) / timeline.joint_rate
        joint_t = offset + np.arange(int((scene.duration - offset) * timeline.joint_rate)) / timeline.joint_rate
        t = np.union1d(scene.stamps[keep], joint_t)
        columns = {name: _on(t, joint_t, values) for name, values in _joints(scene, joint_t, rng).items()}
        columns = {"t": t, **columns, "wrench": _on(t, scene.stamps[keep], reading[keep])}
    if not timeline.velocities:
        columns["dq"] = np.full_like(columns["q"], np.nan)
    if timeline.temperature_every:
        kelvin = scene.temperature(t) + THERMOMETER_STD * rng.normal(size=len(t))
        columns["temperature"] = np.where(np.arange(len(t)) % timeline.temperature_every == 0, kelvin, np.nan)
    single = ("dq", "wrench")
    return {name: values.astype(np.float32 if name in single else np.float64) for name, values in columns.items()}


def _joints(scene: Scene, t: Floats, rng: np.random.Generator) -> dict[str, Floats]:
    q, dq, _ = scene.motion(t)
    q = q + scene.belief.position_noise_std * rng.normal(size=q.shape)
    return {"q": q, "dq": dq + scene.belief.velocity_noise_std * rng.normal(size=q.shape)}


def _on(t: Floats, stamps: Floats, values: Floats) -> Floats:
    """Place the values (S, k) of a stream on the merged timeline t (T,), NaN elsewhere."""
    out = np.full((len(t), values.shape[1]), np.nan)
    out[np.searchsorted(t, stamps)] = values
    return out
