"""Joint noise above the stated one, by variation that no motion can cause, and velocities inconsistent with positions.

A logger that writes degrees with two decimals makes positions ten times as noisy as their encoder, and a controller
that smooths velocities delays them. If they are used as stated, the tool's wrench has errors from spurious
accelerations, which look like a filter in the sensor.
"""

from typing import Any

import numpy as np

from ftbias_jax.io.log import Repair, Repairs
from ftbias_jax.model.params import JointNoise, Params
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array, Sample

SEGMENTS, SAMPLES = 12, 128
"""Number of evenly spread segments of a log that are examined, and samples of each."""
LOW, HIGH = 4, 6
"""Orders of differences: a higher order removes more of the motion, while the estimate for white noise is the same."""
FLAT = 1.5
"""Ratio of noise by differences of low order to that of high order above which both contain motion."""
LARGE, SHARE = 0.9, 1.6449
"""Quantile of the absolute differences from which noise is estimated, and its value for a standard normal."""
SLOWEST = 1 / 90
"""s between rows; differences of slower rows contain frequencies, up to 30 Hz, at which arms do vibrate."""
FEWEST = 100
"""Minimum number of differences of one column to estimate its noise."""
REGULAR = 0.1
"""Relative variation allowed for the time steps within a difference: beyond it, rows may be missing."""
CHANGES, WHOLE = 20, 0.05
"""Minimum changes of a column to find its rounding step, and how far multiples of it may be from whole numbers."""
LOUDER = 1.3
"""Ratio to the stated noise up to which an excess is attributed to chance."""
WINDOW, LEAST_WINDOWS, FAR = 32, 16, 4.0
"""Rows over which velocities must integrate to the change of position, minimum number of such windows, and longest time
between two rows, in median time steps."""
MORE = 4.0
"""Variances of a position that the mean squared error of such windows exceeds: twice the noise of two positions."""
ALIKE = 0.1
"""Share of the noise of a difference quotient of positions; velocities closer to the quotient were computed from it."""
UNUSED = 1e3
"""rad/s, noise assigned to velocities that contain no information."""


def no_less_than_shown(noise: JointNoise, samples: Sample) -> JointNoise:
    """Measurement noise as stated, or as large as a log shows it to be where that is clearly more.

    Velocities that do not follow the positions, or were computed from them, get the noise UNUSED.

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
    """Rows of a log that are examined; all rows of a short one."""
    if length <= SEGMENTS * SAMPLES:
        return np.arange(length)
    rows: Array = np.linspace(0, length - SAMPLES, SEGMENTS).astype(int)[:, None] + np.arange(SAMPLES)
    return rows.ravel()


def departs(t: Array, q: Array, dq: Array, position_std: Array) -> Array:
    """Whether (n,) velocities (T, n) integrate to other changes than those of positions (T, n) at t (T,) s.

    Over windows of some rows, an error larger than the noise of the positions, (n,) rad, is regressed on the change of
    the velocity, as caused by a lag, and on the path, as caused by another scale: these must explain more of it than
    they leave. Alternatively, the velocity never changes.
    """
    t, q, dq = _where_both(t, q, dq)
    count = len(t) // WINDOW
    if count < LEAST_WINDOWS:
        return np.zeros(q.shape[1], bool)
    t, q, dq = (x[: count * WINDOW].reshape(count, WINDOW, *x.shape[1:]) for x in (t, q, dq))
    steps = np.diff(t, axis=1)
    near = steps.max(1) < FAR * np.median(steps)
    path = (steps[..., None] * (dq[:, 1:] + dq[:, :-1]) / 2).sum(1)[near]
    # For a curved velocity the trapezoidal rule misses the difference of its slopes at end and start (Gregory's rule).
    path -= np.median(steps) / 12 * (dq[:, -1] - dq[:, -2] - dq[:, 1] + dq[:, 0])[near]
    off = (q[:, -1] - q[:, 0])[near] - path
    causes = np.stack([(dq[:, -1] - dq[:, 0])[near], path])
    normal = np.einsum("iwn,jwn->nij", causes, causes)
    # A joint at rest has zero regressors and hence no inverse.
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

    White noise is estimated from high-order differences between neighbours at equal steps of time, and is at least the
    rounding error. Rows that repeat the previous one are ignored: the joints rest there, or their stream is slower than
    the log.
    """
    new = np.isfinite(values).all(1) & (np.diff(values, axis=0, prepend=np.nan) != 0).any(1)
    t, values = t[new], values[new]
    if len(t) < FEWEST:
        return np.zeros(values.shape[1])
    steps = np.diff(t)
    step = np.median(steps)
    regular = (np.abs(steps - step) < REGULAR * step) & (step < SLOWEST)
    low, high = (by_differences(t, values, regular, order) for order in (LOW, HIGH))
    return np.maximum(np.where(low < FLAT * high, high, 0.0), _by_rounding(values))


def by_differences(t: Array, values: Array, regular: Array, order: int) -> Array:
    """Noise (n,) of rows (L, n) at t (L,) s, from differences of this order between rows at nearly regular steps.

    They are divided differences, zero for any polynomial of lower order at these times: at steps that are not quite
    equal, plain ones would have the speed times the irregularity in them. Each is scaled to the noise of one row.
    """
    windows = np.lib.stride_tricks.sliding_window_view
    whole = windows(regular, order).all(1)
    if whole.sum() < FEWEST:
        return np.zeros(values.shape[1])
    at = windows(t, order + 1)[whole]
    weights = 1 / (at[:, :, None] - at[:, None] + np.eye(order + 1)).prod(2)
    weights /= np.sqrt((weights**2).sum(1, keepdims=True))
    sizes = np.abs(np.einsum("wk,wnk->wn", weights, windows(values, order + 1, axis=0)[whole]))
    place = int(LARGE * len(sizes))
    found: Array = np.partition(sizes, place, axis=0)[place] / SHARE
    return found


def _by_rounding(values: Array) -> Array:
    """Rounding noise (n,) of rows (L, n) whose neighbours differ by multiples of one step, whatever the speed.

    A rounding error persists while the value does: over k rows, in which equally large white noise would average out.
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
    """Remarks for the owner where the parameters of a log have more joint noise than the setup states."""
    of_pose = setup.pose is not None
    repairs = []
    for key, what, shown in (
        ("position", "poses" if of_pose else "joint positions", params.joint.position_std),
        ("velocity", "rates of the pose" if of_pose else "joint velocities", params.joint.velocity_std),
    ):
        ratio = float(np.max(np.asarray(shown) / getattr(setup.joints, f"{key}_noise_std")))
        if np.max(shown) >= UNUSED:
            repairs.append(f"{what} lag, have a wrong scale, or were computed from the positions: they are not used")
        elif ratio > LOUDER:
            repairs.append(
                f"{what} scatter {ratio:.2g} times as much as the setup states: their noise is that of the log"
            )
    return tuple(map(Repair, repairs))
