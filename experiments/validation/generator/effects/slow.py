"""The bias and its causes: random walk, warm-up, jumps, temperature, and causes that are not recorded."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from validation.generator.arms import Floats
from validation.generator.effects.effect import Draw, Effect, Scene, uneven


def bias_path(stamps: Floats, density: Floats, rng: np.random.Generator) -> Floats:
    """Draw a bias (T, 6) N, Nm: a random start, a constant drift, and a drift that is a random walk.

    Args:
        stamps: (T,) s.
        density: (6,) N/s^1.5, Nm/s^1.5, of the white noise that drives the drift.
        rng: source of randomness.
    """
    start = rng.uniform(-5, 5, 6) * np.repeat([1.0, 0.06], 3)
    dt = np.diff(stamps, prepend=stamps[0])[:, None]
    rate = rng.normal(0, [0.01] * 3 + [5e-4] * 3) + np.cumsum(np.sqrt(dt) * density * rng.normal(size=(len(dt), 6)), 0)
    return start + np.cumsum(dt * rate, 0)


def random_temperature(duration: float, rng: np.random.Generator) -> Callable[[Floats], Floats]:
    """Draw a room or sensor temperature, time in s -> deg C: smooth wander plus a slow wave, range 2 to 6 K."""
    knots = np.arange(-10.0, duration + 20.0, rng.uniform(5, 9))
    wander = CubicSpline(knots, np.cumsum(rng.normal(0, 1, len(knots))))
    period, phase = rng.uniform(0.4, 0.9) * duration, rng.uniform(0, 2 * np.pi)
    times = np.linspace(0, duration, 200)

    def shape(t: Floats) -> Floats:
        return wander(t) + 1.5 * np.sin(2 * np.pi * t / period + phase)

    low, high = shape(times).min(), shape(times).max()
    middle, swing = rng.uniform(20, 35), rng.uniform(2, 6)
    return lambda t: middle + swing * ((shape(t) - low) / (high - low) - 0.5)


def warmup(form: str, draw: Draw, scene: Scene) -> Effect:
    """Forms: "exponential", "two_exponentials" (electronics, then the body; ``tau`` is that of the electronics)."""
    tau = float(draw.rng.uniform(4, np.clip(scene.duration / 3, 4, 15)))
    amplitude = uneven(draw, draw.size((0.25, 0.5), (0.8, 1.3), (2.5, 4.0)))
    slower = float(draw.rng.uniform(2.5, 5)) * tau
    second = 0.4 if form == "two_exponentials" else 0.0

    def slow(t: Floats) -> Floats:
        rise = (1 - second) * (1 - np.exp(-t / tau)) + second * (1 - np.exp(-t / slower))
        return rise[:, None] * amplitude

    parameters = {"tau": tau, "amplitude": amplitude.tolist()}
    if second:
        parameters |= {"tau_2": slower, "share_2": second}
    return Effect("warmup", form, parameters, slow=slow)


def bias_jump(form: str, draw: Draw, scene: Scene) -> Effect:
    """Forms: "step", "ramp" (within a second), "settling" (overshoots by 40 % and relaxes in two seconds)."""
    time = float(draw.rng.uniform(0.2, 0.8) * scene.duration)
    amplitude = uneven(draw, draw.size((0.1, 0.3), (0.5, 1.0), (1.5, 2.5)))
    seconds = float(draw.rng.uniform(0.2, 1.0))

    def slow(t: Floats) -> Floats:
        after = t - time
        step = np.clip(after / seconds, 0, 1) if form == "ramp" else (after >= 0).astype(float)
        if form == "settling":
            step = step * (1 + 0.4 * np.exp(-np.maximum(after, 0) / 2))
        return step[:, None] * amplitude

    parameters = {"time": time, "amplitude": amplitude.tolist()}
    if form == "ramp":
        parameters["ramp"] = seconds
    return Effect("bias_jump", form, parameters, slow=slow)


def temperature_drift(form: str, draw: Draw, scene: Scene) -> Effect:
    """Forms: "instant", "lagging" (the gauges follow with a time constant), "curved" (with a quadratic part)."""
    per_kelvin = uneven(draw, draw.size((0.04, 0.1), (0.2, 0.35), (0.5, 0.8)), 0.05)
    lag = float(draw.rng.uniform(1.5, 6.0))

    def slow(t: Floats) -> Floats:
        kelvin = scene.temperature(t) - scene.temperature(t[:1])
        if form == "lagging":
            kelvin = lagged(t, kelvin, lag)
        if form == "curved":
            kelvin = kelvin + 0.06 * kelvin**2
        return kelvin[:, None] * per_kelvin

    parameters = {"per_kelvin": per_kelvin.tolist()}
    if form == "lagging":
        parameters["lag"] = lag
    return Effect("temperature_drift", form, parameters, slow=slow)


def lagged(t: Floats, x: Floats, tau: float) -> Floats:
    """Filter x (T,) by a first-order lag of tau s that starts at x[0]; t (T,) s is evenly spaced."""
    keep = np.exp(-(t[1] - t[0]) / tau)
    return lfilter([1 - keep], [1, -keep], x, zi=[keep * x[0]])[0]


def joint_heat(form: str, draw: Draw, scene: Scene) -> Effect:
    """Bias that follows unmeasured heat from the motion of the joints. Unlisted."""
    amplitude = uneven(draw, draw.size((0.2, 0.4), (0.8, 1.5), (2.0, 4.0)))
    tau = float(draw.rng.uniform(4, 12))

    def slow(t: Floats) -> Floats:
        heat = lagged(t, (scene.motion(t)[1] ** 2).sum(1), tau)
        return ((heat - heat[0]) / np.ptp(heat))[:, None] * amplitude

    return Effect("joint_heat", form, {"amplitude": amplitude.tolist(), "tau": tau}, slow=slow)


def wandering_bursts(form: str, draw: Draw, scene: Scene) -> Effect:
    """Loose connector: the bias makes a random walk during a few bursts and keeps its last value. Unlisted."""
    density = uneven(draw, draw.size((0.05, 0.1), (0.2, 0.4), (0.6, 1.2)))
    stream = draw.stream()
    starts = np.sort(draw.rng.uniform(0.05, 0.9, 4)) * scene.duration
    seconds = draw.rng.uniform(1.5, 4.0, 4)

    def slow(t: Floats) -> Floats:
        loose = np.any((t[:, None] > starts) & (t[:, None] < starts + seconds), 1)
        steps = np.sqrt(t[1] - t[0]) * stream().normal(size=(len(t), 6))
        return np.cumsum(steps * np.asarray(loose)[:, None], 0) * density

    bursts = np.stack([starts, seconds], 1).tolist()
    return Effect("wandering_bursts", form, {"density": density.tolist(), "bursts": bursts}, slow=slow)


def mains_hum(form: str, draw: Draw, scene: Scene) -> Effect:
    """50 Hz sine with a separate phase on every channel. Unlisted."""
    sizes = draw.size((0.8, 1.2), (1.5, 2.5), (4.0, 6.0)) * draw.rng.uniform(0.4, 1.2, 6) * scene.belief.noise_std
    phase, hz = draw.rng.uniform(0, 2 * np.pi, 6), 50 * (1 + float(draw.rng.normal(0, 2e-4)))

    def slow(t: Floats) -> Floats:
        return sizes * np.sin(2 * np.pi * hz * t[:, None] + phase)

    return Effect("mains_hum", form, {"amplitude": sizes.tolist(), "hz": hz}, slow=slow)
