"""Effects of clocks and transport: late, uneven or missing samples of the wrench."""

from __future__ import annotations

import numpy as np

from validation.generator.arms import Floats
from validation.generator.effects.effect import Draw, Effect, Scene


def time_delay(form: str, draw: Draw, scene: Scene) -> Effect:
    """Forms: "constant", "clock_skew" (the delay grows by a fifth over the log; ``delay`` is its mean)."""
    delay = min(draw.size((0.006, 0.015), (0.02, 0.05), (0.08, 0.15)), 0.5)
    skew = 0.2 if form == "clock_skew" else 0.0

    def clock(stamps: Floats) -> Floats:
        return stamps - delay * (1 + skew * (stamps / scene.duration - 0.5))

    return Effect("time_delay", form, {"delay": delay}, clock=clock)


def stamp_jitter(form: str, draw: Draw, scene: Scene) -> Effect:
    """Forms: "gaussian", "latency" (exponential, with its known mean removed), "bursts" (occasional, larger)."""
    std = min(draw.size((0.005, 0.01), (0.012, 0.025), (0.03, 0.06)), 0.15)
    stream = draw.stream()

    def clock(stamps: Floats) -> Floats:
        rng = stream()
        if form == "latency":
            return stamps - std * (rng.exponential(1.0, len(stamps)) - 1)
        error = rng.normal(size=len(stamps))
        if form == "bursts":
            block = (stamps / 0.5).astype(int)
            error = error * np.sqrt(5) * (rng.uniform(size=block.max() + 1) < 0.2)[block]
        return stamps + std * error

    return Effect("stamp_jitter", form, {"std": std}, clock=clock)


def dropped_samples(form: str, draw: Draw, scene: Scene) -> Effect:
    """Forms: "rows" (missing rows), "repeats" (the last wrench repeated), "nan", "gaps" (up to 0.2 s each)."""
    rate = draw.size((0.03, 0.06), (0.1, 0.15), (0.25, 0.4))
    stream = draw.stream()

    def lost(count: int) -> np.ndarray:
        rng = stream()
        run = 1 if form in ("rows", "nan") else max(2, round((0.2 if form == "gaps" else 0.03) * scene.rate))
        starts = rng.uniform(size=count) < rate / (0.5 * (run + 1))
        ends = np.arange(count) + rng.integers(1, run + 1, count)
        return np.arange(count) < np.maximum.accumulate(np.where(starts, ends, 0)) * (np.arange(count) > 0)

    def reading(w: Floats) -> Floats:
        gone = lost(len(w))
        if form == "nan":
            return np.where(gone[:, None], np.nan, w)
        return w[np.maximum.accumulate(np.where(gone, 0, np.arange(len(w))))] if form == "repeats" else w

    def keep(stamps: Floats) -> np.ndarray:
        return ~lost(len(stamps)) if form in ("rows", "gaps") else np.ones(len(stamps), bool)

    return Effect("dropped_samples", form, {"rate": rate}, reading=reading, keep=keep)
