"""Joints that are noisier than stated, by what no motion can cause, and velocities that are not those of the positions.

A logger that writes degrees with two decimals makes positions ten times as noisy as their encoder, and a controller
that smooths velocities makes them late. If they are believed as stated, the wrench of the tool has errors of
accelerations that nobody made, which look like a filter in the sensor.
"""

from math import comb
from typing import Any

import numpy as np

from ftbias_jax.io.log import Repair, Repairs
from ftbias_jax.model.params import JointNoise, Params
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array, Sample

STRETCHES, SAMPLES = 12, 128
"""Of a log, that are looked at: so many, of so many samples, evenly spread."""
LOW, HIGH = 4, 6
"""Orders of differences: each takes away more of a motion, and makes the same of white noise."""
FLAT = 1.5
"""Noise by differences of low order over that of high order: with more of it, motion is in both."""
LARGE, SHARE = 0.9, 1.6449
"""Quantile of sizes of differences by which noise is measured, and its value for a standard normal."""
SLOWEST = 1 / 90
"""s between rows: differences of slower ones hold frequencies, up to 30 Hz, at which arms do vibrate."""
FEWEST = 100
"""Differences of one column that tell its noise."""
REGULAR = 0.1
"""Share by which the steps of time within a difference may vary."""
CHANGES, WHOLE = 20, 0.05
"""Of a column that tell the step of rounding, and by which a multiple of it may be no whole number."""
LOUDER = 1.3
"""Times the stated noise; less is chance."""
WINDOW, LEAST_WINDOWS, FAR = 32, 16, 4.0
"""Rows over which velocities must add up to the change of the positions, how many such windows tell, and times the
usual step of time that there may be between two rows."""
MORE = 4.0
"""Variances of a position by which such windows are off at least: twice what the noise of two positions makes."""
ALIKE = 0.1
"""Of the noise of a difference of two positions by its time: velocities nearer to it were worked out so."""
UNUSED = 1e3
"""rad/s, noise of velocities that tell nothing."""


def no_less_than_shown(noise: JointNoise, samples: Sample) -> JointNoise:
    """Measurement noise as stated, or as large as a log shows it to be where that is clearly more.

    That of velocities that do not follow the positions, or were worked out from them, is UNUSED.

    Args:
        noise: as stated.
        samples: of one log, leaves (T, ...).
    """
    dt, q, dq = (np.asarray(x, np.float64) for x in (samples.dt, samples.q, samples.dq))
    rows = _spread(len(dt))
    t, q, dq = np.cumsum(dt)[rows], q[rows], dq[rows]

    def of(stated: Array, shown: Array) -> Any:
        return np.asarray(np.where(shown > LOUDER * np.asarray(stated), shown, stated), stated.dtype)

    of_positions = scatter(t, q)
    position_std = of(noise.position_std, of_positions)
    useless = departs(t, q, dq, position_std) | derived(t, q, dq, of_positions)
    of_velocities = np.where(useless, UNUSED, scatter(t, dq))
    return noise._replace(position_std=position_std, velocity_std=of(noise.velocity_std, of_velocities))


def _spread(length: int) -> Array:
    """Rows of a log that are looked at: all of a short one."""
    if length <= STRETCHES * SAMPLES:
        return np.arange(length)
    rows: Array = np.linspace(0, length - SAMPLES, STRETCHES).astype(int)[:, None] + np.arange(SAMPLES)
    return rows.ravel()


def departs(t: Array, q: Array, dq: Array, position_std: Array) -> Array:
    """Whether (n,) velocities (T, n) add up to other changes than those of positions (T, n) at t (T,) s.

    Over windows of some rows what is off, if it is more than noise of the positions, (n,) rad, is compared with the
    change of the velocity, as of one that lags, and with the path, as of one of another scale: these explain more of it
    than they leave. Or else the velocity never changes.
    """
    t, q, dq = _where_both(t, q, dq)
    count = len(t) // WINDOW
    if count < LEAST_WINDOWS:
        return np.zeros(q.shape[1], bool)
    t, q, dq = (x[: count * WINDOW].reshape(count, WINDOW, *x.shape[1:]) for x in (t, q, dq))
    steps = np.diff(t, axis=1)
    near = steps.max(1) < FAR * np.median(steps)
    path = (steps[..., None] * (dq[:, 1:] + dq[:, :-1]) / 2).sum(1)[near]
    # Of a velocity that bends, trapezoids miss what its slope at the end has more than at the start (Gregory's rule).
    path -= np.median(steps) / 12 * (dq[:, -1] - dq[:, -2] - dq[:, 1] + dq[:, 0])[near]
    off = (q[:, -1] - q[:, 0])[near] - path
    causes = np.stack([(dq[:, -1] - dq[:, 0])[near], path])
    normal = np.einsum("iwn,jwn->nij", causes, causes)
    # Of a joint at rest there is nothing to explain it by, and no inverse.
    share = np.einsum("nij,jwn,wn->ni", np.linalg.pinv(normal, hermitian=True), causes, off)
    explained = np.einsum("ni,iwn->wn", share, causes)
    follows = (explained**2).sum(0) > ((off - explained) ** 2).sum(0)
    is_off = (off**2).sum(0) > MORE * near.sum() * position_std**2
    found: Array = (follows | (dq == dq[0, 0]).all((0, 1))) & is_off
    return found & (near.sum() >= LEAST_WINDOWS)


def derived(t: Array, q: Array, dq: Array, noise: Array) -> Array:
    """Whether (n,) velocities (T, n) are differences of positions (T, n), whose noise (n,) is then in both."""
    t, q, dq = (x[:FEWEST] for x in _where_both(t[:, None], q, dq))
    if len(t) < FEWEST:
        return np.zeros(q.shape[1], bool)
    slopes = np.diff(q, axis=0) / np.diff(t, axis=0)
    central = (q[2:] - q[:-2]) / (t[2:] - t[:-2])
    off = [np.median(np.abs(dq[1:-1] - x), axis=0) for x in (central, slopes[:-1], slopes[1:])]
    found: Array = np.min(off, axis=0) < ALIKE * noise / np.median(np.diff(t, axis=0))
    return found


def _where_both(t: Array, q: Array, dq: Array) -> tuple[Array, Array, Array]:
    """The rows in which positions and velocities of all joints are measured."""
    known = np.isfinite(q).all(1) & np.isfinite(dq).all(1)
    return t[known], q[known], dq[known]


def scatter(t: Array, values: Array) -> Array:
    """Standard deviation (n,) of noise in columns (T, n) at t (T,) s; 0 = not known, or hidden by the motion.

    That of white noise from differences of high order between neighbours, at equal steps of time, and no less than that
    of rounding. Rows that repeat the one before say nothing: there the joints rest, or their stream is slower than the
    log.
    """
    new = np.isfinite(values).all(1) & (np.diff(values, axis=0, prepend=np.nan) != 0).any(1)
    t, values = t[new], values[new]
    if len(t) < FEWEST:
        return np.zeros(values.shape[1])
    steps = np.diff(t)
    step = np.median(steps)
    regular = (np.abs(steps - step) < REGULAR * step) & (step < SLOWEST)
    low, high = (_by_differences(values, regular, order) for order in (LOW, HIGH))
    return np.maximum(np.where(low < FLAT * high, high, 0.0), _by_rounding(values))


def _by_differences(values: Array, regular: Array, order: int) -> Array:
    """(n,) of rows (L, n), by those differences of an order between rows whose steps (L - 1,) are all regular."""
    whole = np.lib.stride_tricks.sliding_window_view(regular, order).all(1)
    if whole.sum() < FEWEST:
        return np.zeros(values.shape[1])
    sizes = np.abs(np.diff(values, order, axis=0))[whole]
    place = int(LARGE * len(sizes))
    found: Array = np.partition(sizes, place, axis=0)[place] / (SHARE * np.sqrt(comb(2 * order, order)))
    return found


def _by_rounding(values: Array) -> Array:
    """(n,) of rows (L, n) whose neighbours differ by multiples of one step, whatever the speed.

    The error of rounding stays while a value does: over k rows, in which as much white noise would average out.
    """
    sizes = np.abs(np.diff(values, axis=0))
    sizes[sizes == 0] = np.nan
    step = np.nanmin(sizes, axis=0, initial=np.inf)
    multiples = sizes / step
    known = np.isfinite(sizes).sum(0)
    fits = (np.abs(multiples - np.round(multiples)) < WHOLE).sum(0)
    stays = len(sizes) / np.maximum(known, 1)
    return np.where((known >= CHANGES) & (fits == known), step * np.sqrt(stays / 12), 0.0)


def remark_of_joints(setup: Setup, params: Params) -> Repairs:
    """What the owner should know where the parameters of a log have more noise of the joints than the setup states."""
    of_pose = setup.pose is not None
    told = []
    for key, what, shown in (
        ("position", "poses" if of_pose else "joint positions", params.joint.position_std),
        ("velocity", "rates of the pose" if of_pose else "joint velocities", params.joint.velocity_std),
    ):
        ratio = float(np.max(np.asarray(shown) / getattr(setup.joints, f"{key}_noise_std")))
        if np.max(shown) >= UNUSED:
            told.append(f"{what} are late, of another scale, or worked out from the positions: they are not used")
        elif ratio > LOUDER:
            told.append(f"{what} scatter {ratio:.2g} times as much as the setup states: their noise is that of the log")
    return tuple(map(Repair, told))
