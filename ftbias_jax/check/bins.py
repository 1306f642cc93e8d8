"""Reduction of a log to short time bins: mean wrench per bin, and joint motion at its time from a parabola fit."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ftbias_jax.io.log import Log
from ftbias_jax.io.pose import interpolated, product
from ftbias_jax.io.tables.poses import Poses
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

WIDTH = 0.1
"""s, width of a bin: wide enough to estimate accelerations, short enough that they hardly change within it."""
LEAST = 6
"""Minimum number of joint samples per bin; a sparser log gets wider bins."""
WIDEST = 0.5
"""s; joint samples that are half of this or more apart are poses at rest."""
MOST = 150_000
"""Maximum number of samples that are binned; of a longer log only some segments are."""
SEGMENT_BINS, PIECES = 200, 8
"""Consecutive bins per segment, and maximum number of segments, for a log that is too long to be binned as a whole."""
SPEED, ACCELERATION = 10.0, 50.0
"""rad/s, rad/s^2 or m/s, m/s^2: standard deviations of a very weak prior, which makes sparse bins solvable."""


class Bins(NamedTuple):
    """Means of a log over N bins; NaN where an axis was not measured."""

    t: Float[Array, " N"]
    """s, of the log; increasing."""
    q: Float[Array, "N n"]
    """rad, m; for a recorded pose: its entries, fitted without the recorded rates."""
    dq: Float[Array, "N n"]
    ddq: Float[Array, "N n"]
    wrench: Float[Array, "N 6"]
    """N, Nm; mean wrench on the tool, as in the log."""
    count: Float[Array, " N"]
    """Number of wrench samples per bin."""
    gyroscope: Array | None = None
    """(N, 3) rad/s, sensor frame, angular velocity as recorded; None = not recorded."""
    acceleration: Array | None = None
    """(N, 3) m/s^2, base frame, from an accelerometer and the orientation as stated; None = no accelerometer."""
    piece: Array | None = None
    """(N,) number of times that, according to the setup, the sensor had been set to zero before; None = never."""


def bins_of(log: Log | Poses, setup: Setup) -> Bins:
    """Reduce a log to bins with both motion and wrench; each static pose is one bin, regardless of its time.

    The setup states the noise of the joint measurements, and whether a pose was recorded instead of joints.
    """
    if isinstance(log, Poses):
        rest, number = np.zeros_like(log.q), np.arange(len(log.q), dtype=float)
        return Bins(number, log.q, rest, rest, log.wrench, np.ones(len(number)))
    rezeroed_at, log = np.sort(log.rezeroed_at), _stretches(log)
    joints = np.isfinite(log.q).any(1) | np.isfinite(log.dq).any(1)
    step = np.median(np.diff(log.t[joints])) if joints.sum() > 1 else WIDTH
    width = max(WIDTH, LEAST * step) if step < WIDEST / 2 else step
    label = np.floor((log.t - log.t[0]) / width).astype(int)
    first = np.flatnonzero(np.diff(label, prepend=-1))
    half = width / 2
    u = (log.t - log.t[0] - (label + 0.5) * width) / half

    read = np.isfinite(log.wrench)
    measured = read.any(1)
    count = _sums(measured, first)
    with np.errstate(invalid="ignore", divide="ignore"):
        wrench = _sums(np.where(read, log.wrench, 0), first) / _sums(read, first)
        at = _sums(np.where(measured, u, 0), first) / count
    at = np.nan_to_num(at)
    noise, rate_noise = setup.joints.position_noise_std, setup.joints.velocity_noise_std
    pose = setup.pose is not None
    rates = np.full_like(log.dq, np.nan) if pose else log.dq
    q, dq, ddq = _parabola(log.q, rates, u, first, half, (noise, rate_noise), at)
    if step >= WIDEST / 2:
        dq, ddq = np.zeros_like(q), np.zeros_like(q)
    gyroscope = _gyroscope(log, setup, u, first, at) if pose else None
    acceleration = None
    if setup.pose is not None and setup.pose.linear == "specific_force":
        acceleration = _line(log.dq[:, 4:], u, first, np.zeros_like(at))[1] / half
        q[:, 4:], dq[:, 4:], ddq[:, 4:] = 0, 0, acceleration
    whole = np.isfinite(q).all(1) & np.isfinite(ddq).all(1) & (count > 0)
    t = log.t[0] + (label[first] + 0.5) * width + at * half
    piece = np.searchsorted(rezeroed_at, t) if len(rezeroed_at) else None
    bins = Bins(t, q, dq, ddq, wrench, count, gyroscope, acceleration, piece)
    return Bins(*(None if x is None else x[whole] for x in bins))


def join_bins(parts: Iterable[Bins]) -> Bins:
    """Concatenate the bins of several logs; a field that one of them lacks is None."""
    columns = zip(*parts, strict=True)
    return Bins(*(None if any(x is None for x in column) else np.concatenate(column) for column in columns))


def _stretches(log: Log) -> Log:
    """Return the log, or evenly spread segments of it if it has more than MOST samples."""
    if len(log.t) <= MOST:
        return log
    samples = max(LEAST * SEGMENT_BINS, round(SEGMENT_BINS * WIDTH / max(np.median(np.diff(log.t)), 1e-6)))
    pieces = max(1, min(MOST // samples, PIECES))
    is_in = np.zeros(len(log.t), bool)
    for start in np.linspace(0, max(0, len(log.t) - samples), pieces).astype(int):
        is_in[start : start + samples] = True
    rows = np.flatnonzero(is_in)
    t, q, dq, wrench, temperature = (x[rows] for x in log[:5])
    return Log(t, q, dq, wrench, temperature, log.start)


def _sums(values: Array, first: Array) -> Array:
    return np.add.reduceat(values, first, axis=0, dtype=float)


def _parabola(
    values: Array, rates: Array, u: Array, first: Array, half: float, noise: tuple[Array, Array], at: Array
) -> tuple[Array, Array, Array]:
    """Fit c0 + c1 u + c2 u^2 to values and its slope to rates in each bin by least squares; evaluate at u = ``at``.

    Returns:
        value, rate and acceleration (N, n); NaN where a bin has no value.
    """
    u = u[:, None]
    has, has_rate = np.isfinite(values), np.isfinite(rates)
    x, v = np.where(has, values, 0), np.where(has_rate, rates * half, 0)
    powers = [np.ones_like(u), u, u**2, u**3, u**4]
    # If every sample has all joints or none, the sums over powers of time are equal for all joints.
    has, has_rate = (each[:, :1] if (each == each[:, :1]).all() else each for each in (has, has_rate))
    S = [_sums(has * power, first) for power in powers]
    V = [_sums(has_rate * power, first) for power in powers[:3]]
    weight = (noise[0] / (noise[1] * half)) ** 2
    prior = [(noise[0] / (SPEED * half)) ** 2, (2 * noise[0] / (ACCELERATION * half**2)) ** 2]
    normal = np.empty((len(first), x.shape[1], 3, 3))
    right = np.stack([_sums(x * power, first) for power in powers[:3]], -1)
    for i in range(3):
        for j in range(3):
            normal[..., i, j] = S[i + j]
            if i and j:  # the slope of u^i is i u^(i - 1)
                normal[..., i, j] += i * j * weight * V[i + j - 2] + (i == j) * prior[i - 1]
        if i:
            right[..., i] += i * weight * _sums(v * powers[i - 1], first)
    empty = np.broadcast_to(S[0] == 0, right.shape[:2])
    normal[empty] = np.eye(3)
    c = np.linalg.solve(normal, right[..., None])[..., 0]
    c[empty] = np.nan
    at = at[:, None]
    return (
        c[..., 0] + c[..., 1] * at + c[..., 2] * at**2,
        (c[..., 1] + 2 * c[..., 2] * at) / half,
        2 * c[..., 2] / half**2,
    )


def _line(values: Array, u: Array, first: Array, at: Array) -> tuple[Array, Array]:
    """Fit a line to the values of each bin: value at u = ``at`` and slope (N, k); slope 0 for a single value."""
    u = u[:, None]
    has = np.isfinite(values)
    x = np.where(has, values, 0)
    n, s, ss = (_sums(has * u**k, first) for k in range(3))
    y, sy = _sums(x, first), _sums(x * u, first)
    with np.errstate(invalid="ignore", divide="ignore"):
        spread = ss - s * s / n
        slope = np.where(spread > 1e-6, (sy - s * y / n) / spread, 0)
        return y / n + slope * (at[:, None] - s / n), slope


def _gyroscope(log: Log, setup: Setup, u: Array, first: Array, at: Array) -> Array | None:
    """Recover the recorded angular velocity from the quaternion rates that ``io.pose`` converted it to."""
    if not all(np.isfinite(x[:, :4]).all(1).any() for x in (log.q, log.dq)):
        return None
    turn = 2 * product(interpolated(log.q[:, :4], log.t) * [1, -1, -1, -1], log.dq[:, :4])[:, 1:]
    return _line(turn @ setup.sensor.rotation, u, first, at)[0]
