"""How much measured joints scatter, by what no motion can cause: noise that is larger than stated, rounding too.

A logger that writes degrees with two decimals makes positions ten times as noisy as their encoder. If they are believed
as stated, the wrench of the tool has errors of accelerations that nobody made, which look like a filter in the sensor.
"""

from math import comb
from typing import Any

import numpy as np

from ftbias_jax.io.log import Repair, Repairs
from ftbias_jax.model.params import JointNoise, Params
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array, Sample

STRETCHES, SAMPLES = 16, 128
"""Of a log, that are looked at: so many, of so many samples, evenly spread."""
LOW, HIGH = 4, 6
"""Orders of differences: each takes away more of a motion, and makes the same of white noise."""
FLAT = 1.5
"""Noise by differences of low order over that of high order: with more of it, motion is in both."""
LARGE, SHARE = 0.9, 1.6449
"""Quantile of sizes of differences by which noise is measured, and its value for a standard normal."""
FEWEST = 100
"""Differences of one column that tell its noise."""
REGULAR = 0.1
"""Share by which the steps of time within a difference may vary."""
WHOLE = 0.05
"""By which a multiple of the step of rounding may be no whole number."""
LOUDER = 1.25
"""Times the stated noise; less is chance."""


def no_less_than_shown(noise: JointNoise, samples: Sample) -> JointNoise:
    """Measurement noise as stated, or as large as a log shows it to be where that is clearly more.

    Args:
        noise: as stated.
        samples: of one log, leaves (T, ...).
    """
    t = np.cumsum(np.asarray(samples.dt, np.float64))

    def of(stated: Array, values: Array) -> Any:
        shown = scatter(t, np.asarray(values, np.float64))
        return np.asarray(np.where(shown > LOUDER * np.asarray(stated), shown, stated), stated.dtype)

    return noise._replace(
        position_std=of(noise.position_std, samples.q), velocity_std=of(noise.velocity_std, samples.dq)
    )


def scatter(t: Array, values: Array) -> Array:
    """Standard deviation (n,) of noise in columns (T, n) at t (T,) s; 0 = not known, or hidden by the motion.

    That of white noise from differences of high order between neighbours, at equal steps of time, and no less than that
    of rounding. Rows that repeat the one before say nothing: there the joints rest, or their stream is slower than the
    log.
    """
    starts = np.linspace(0, max(0, len(t) - SAMPLES), STRETCHES if len(t) > SAMPLES else 1).astype(int)
    rows = (starts[:, None] + np.arange(min(SAMPLES, len(t)))).ravel()
    t, values = t[rows], values[rows]
    new = np.isfinite(values).all(1) & (np.diff(values, axis=0, prepend=np.nan) != 0).any(1)
    t, values = t[new], values[new]
    if len(t) < FEWEST:
        return np.zeros(values.shape[1])
    steps = np.diff(t)
    regular = np.abs(steps - np.median(steps)) < REGULAR * np.median(steps)
    low, high = (_by_differences(values, regular, order) for order in (LOW, HIGH))
    return np.maximum(np.where(low < FLAT * high, high, 0.0), _by_rounding(values))


def _by_differences(values: Array, regular: Array, order: int) -> Array:
    """(n,) of rows (L, n), by those differences of an order between rows whose steps (L - 1,) are all regular."""
    whole = np.lib.stride_tricks.sliding_window_view(regular, order).all(1)
    if whole.sum() < FEWEST:
        return np.zeros(values.shape[1])
    sizes = np.abs(np.diff(values, order, axis=0))[whole]
    found: Array = np.quantile(sizes, LARGE, axis=0) / (SHARE * np.sqrt(comb(2 * order, order)))
    return found


def _by_rounding(values: Array) -> Array:
    """(n,) of rows (L, n) whose neighbours differ by multiples of one step, whatever the speed."""
    sizes = np.abs(np.diff(values, axis=0))
    sizes[sizes == 0] = np.nan
    step = np.nanmin(sizes, axis=0, initial=np.inf)
    multiples = sizes / step
    known = np.isfinite(sizes).sum(0)
    fits = (np.abs(multiples - np.round(multiples)) < WHOLE).sum(0)
    return np.where((known >= FEWEST) & (fits == known), step / np.sqrt(12), 0.0)


def remark_of_joints(setup: Setup, params: Params) -> Repairs:
    """What the owner should know where the parameters of a log have more noise of the joints than the setup states."""
    of_pose = setup.pose is not None
    told = []
    for key, what, shown in (
        ("position", "poses" if of_pose else "joint positions", params.joint.position_std),
        ("velocity", "rates of the pose" if of_pose else "joint velocities", params.joint.velocity_std),
    ):
        ratio = float(np.max(np.asarray(shown) / getattr(setup.joints, f"{key}_noise_std")))
        if ratio > LOUDER:
            told.append(
                Repair(f"{what} scatter {ratio:.2g} times as much as the setup states: their noise is the log's")
            )
    return tuple(told)
