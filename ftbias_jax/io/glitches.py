"""Detection of joint readings that no arm can have produced: messages of zeros, flipped bits, stale repeats.

One such reading among 20,000 matters where the acceleration of joints is estimated from their positions: 0.01 rad for
one sample at 500 Hz is 5000 rad/s^2.
"""

from typing import NamedTuple

import numpy as np

from ftbias_jax.types import Array

ACCELERATION = 100.0
"""rad/s^2 or m/s^2, more than arms reach: a jump is a step that this over one interval does not explain."""
HALT = 5.0
"""rad/s^2 or m/s^2, deceleration from steady speed above which a standstill to the last digit is a stale reading: a
braking arm slows down before it stands still."""
NOISE, USUAL = 16.0, 0.95
"""A jump exceeds this quantile (USUAL) of the steps' excess this many times (NOISE): where readings arrive slightly
late, an occasional step covers several intervals."""
FINEST, STEPS = 0.05, 5.0
"""Quantile of nonzero steps that is the resolution of a coarse encoder, and number of these that a jump exceeds."""
FASTEST = 0.99
"""Quantile of the speeds to which the speed after a jump is limited."""
LONGEST = 0.5
"""s, longest time until a joint returns from a jump, or repeats one reading; whatever lasts longer may be real."""
SPAN = 7
"""Number of steps whose median gives the speed of an arm at the ends of a log."""
FEWEST = 100
"""Minimum number of readings from which the motion of an arm can be judged."""
NONE = np.zeros(0, int)


class Glitches(NamedTuple):
    """Stamps, s, of invalid joint readings; usually there are none."""

    repeats: Array = np.zeros(0)
    """Readings, position and speed, that occasionally repeat the previous one while the arm moves."""
    joints: Array = np.zeros(0)
    """Readings at positions that no arm can have reached; the speeds in the same messages are invalid as well."""
    speeds: Array = np.zeros(0)
    """Readings of which only the speed is invalid."""
    breaks: Array = np.zeros(0)
    """First readings after a jump from which the joints do not return, without any reading in between."""


def find_glitches(t: Array, q: Array, dq: Array, *, repeats: bool = True) -> Glitches:
    """Find invalid readings of joints q, dq (T, n), rad and per s, at increasing t (T,) s; repeats only on request."""
    stale = find_repeats(t, q) if repeats else NONE
    others = np.delete(np.arange(len(t)), stale) if len(stale) else slice(None)  # usually a slice, without a copy
    times = t[others]
    off, elsewhere = find_jumps(times, q[others])
    of_speeds, _ = find_jumps(times, dq[others], order=1)
    return Glitches(t[stale], times[off], times[np.setdiff1d(of_speeds, off)], times[elsewhere])


def find_jumps(t: Array, x: Array, order: int = 2) -> tuple[Array, Array]:
    """Rows (G,) on which joints have jumped away, and rows (B,) from which they stay elsewhere.

    A joint has returned from a jump when it is where it can have moved meanwhile.

    Args:
        t: (T,) s, increasing.
        x: (T, n) NaN = not measured.
        order: how often acceleration was integrated: 2 = x are positions, 1 = speeds.

    Returns:
        both, usually empty; rows that are off at the beginning or end of a log span at most LONGEST.
    """
    off, breaks = [NONE], [NONE]
    for rows, times, values in _together(t, x):
        if len(times) < FEWEST:
            continue
        least = ACCELERATION * float(np.median(np.diff(times))) ** order
        steps = np.diff(values, axis=0)
        for column in np.flatnonzero(np.abs(np.diff(steps, axis=0)).max(0) > least):
            jumped, stays = _off(times, _turned(steps[:, column]), least)
            off.append(rows[jumped])
            breaks.append(rows[stays])
    return np.unique(np.concatenate(off)), np.setdiff1d(np.concatenate(breaks), np.concatenate(off))


def find_repeats(t: Array, q: Array) -> Array:
    """(G,) rows of q (T, n) rad at t (T,) s that repeat the previous one, though the arm moves just before or after."""
    return np.unique(np.concatenate([NONE, *(rows[_stale(*measured)] for rows, *measured in _together(t, q))]))


def _stale(t: Array, q: Array) -> Array:
    """Rows that ``find_repeats`` returns, for joints that were all measured."""
    same = np.ones(max(len(t) - 1, 0), bool)
    for joint in q.T:
        same &= joint[1:] == joint[:-1]
        if not same.any():
            return NONE
    edges = np.diff(np.r_[0, same, 0].astype(int))
    first, last = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)  # rows of the reading, and of its last repeat
    lengths = np.abs(np.diff(q, axis=0))
    least = np.maximum(HALT * float(np.median(np.diff(t))) ** 2, STEPS * _finest(lengths))
    steps = np.pad(lengths, ((3, 4), (0, 0)))
    beside = [np.stack([steps[row + k] for k in range(3)]) for row in (first, last + 4)]
    steady = [(three.min(0) > np.maximum(least, three.max(0) / 2)).any(1) for three in beside]
    stopped = (steady[0] | steady[1]) & (t[last] - t[first] <= LONGEST)
    runs = zip(first[stopped], last[stopped], strict=True)
    return np.concatenate([NONE, *(np.arange(a + 1, b + 1) for a, b in runs)])


def _together(t: Array, x: Array) -> list[tuple[Array, Array, Array]]:
    """Group columns of x (T, n) that were measured on the same rows: these rows, their stamps t (T,), the values."""
    if not np.isnan(x @ np.ones(x.shape[1])).any():
        return [(np.arange(len(x)), t, x)]
    seen, groups = ~np.isnan(x.T), []
    left = np.flatnonzero(seen.any(1))
    while len(left):
        same = (seen[left] == seen[left[0]]).all(1)
        rows = np.flatnonzero(seen[left[0]])
        groups.append((rows, t[rows], x[np.ix_(rows, left[same])]))
        left = left[~same]
    return groups


def _finest(lengths: Array) -> Array:
    """(n,) shortest nonzero steps (T, n), apart from the FINEST share of them; 0 if there are none."""
    return np.array([np.quantile(x[x > 0], FINEST) if x.any() else 0.0 for x in lengths.T])


class _Speeds(NamedTuple):
    """Speeds of one column, in its unit per s."""

    before: Array
    """(T - 1,) median speed of the three steps before each step."""
    after: Array
    """(T - 1,) median speed of the three steps after each step."""
    last: float
    """Speed at the end of the log."""
    fastest: float
    """Limit of plausible speeds; see FASTEST."""


def _speeds(steps: Array, took: Array, interval: float) -> _Speeds:
    """Speeds around steps (T - 1,) that ``took`` (T - 1,) s each; ``interval`` is the usual duration, s."""
    speeds = steps / np.maximum(took, interval / 2)
    first, last = np.median(speeds[:SPAN]), np.median(speeds[-SPAN:])
    a, b, c = (np.r_[[first] * 3, speeds, [last] * 3][k:][: len(steps) + 4] for k in range(3))
    middle = np.maximum(np.minimum(a, b), np.minimum(np.maximum(a, b), c))
    return _Speeds(middle[:-4], middle[4:], float(last), float(np.quantile(np.abs(speeds), FASTEST)))


def _excess(steps: Array, took: Array, interval: float, speeds: _Speeds) -> Array:
    """(T - 1,) distance of each step from the range that the speeds before and after it explain."""
    either = np.stack([speed * time for speed in (speeds.before, speeds.after) for time in (took, interval)])
    low, high = either.min(0), either.max(0)
    lost = speeds.fastest * np.maximum(took - interval, 0)  # lost samples leave room for more motion
    return np.maximum(np.maximum(steps - high, low - steps), 0) - (high - low) - lost


def _off(t: Array, steps: Array, least: float) -> tuple[Array, Array]:
    """As ``find_jumps``, for one column with steps (T - 1,) at t (T,) s; a step below ``least`` is no jump."""
    took = np.diff(t)
    interval = float(np.median(took))
    speeds = _speeds(steps, took, interval)
    excess = _excess(steps, took, interval, speeds)
    finest = float(_finest(np.abs(steps)[:, None])[0])
    least = max(least, NOISE * float(np.quantile(excess, USUAL)), STEPS * finest)
    x, off, back, speed = np.r_[0.0, np.cumsum(steps)], [NONE], -3, 0.0
    breaks = []
    for jump in np.flatnonzero(excess > least):
        if jump < back:
            continue
        speed = speeds.before[jump] if jump >= back + 3 else speed  # no valid speed precedes a second jump
        rows = np.arange(jump + 1, np.searchsorted(t, t[jump] + LONGEST, "right"))
        later = np.clip(np.r_[speeds.after, speeds.last][rows - 1], -speeds.fastest, speeds.fastest)
        gap = t[rows] - t[jump]
        reach = least + np.abs(speed - later) / 2 * gap
        near = np.abs(_turned(x[rows] - x[jump] - (speed + later) / 2 * gap)) <= reach
        jumps_back = np.abs(steps[rows - 1] - later * took[rows - 1]) > least
        near &= np.r_[near[1:], True] & jumps_back  # being near by chance or in passing is no return
        away = int(near.argmax()) if near.any() else len(t)
        if jump < away and t[jump] - t[0] <= LONGEST:
            off.append(np.arange(jump + 1))
        elif near.any():
            back = rows[away]
            off.append(np.arange(jump + 1, back))
        elif t[-1] - t[jump] <= LONGEST:
            off.append(rows)
            break
        else:
            breaks.append(int(jump) + 1)
    return np.concatenate(off), np.array(breaks, int)


def _turned(angles: Array) -> Array:
    """Angles minus whole turns, because an angle that wraps around has not jumped."""
    return angles - 2 * np.pi * np.rint(angles / (2 * np.pi))
