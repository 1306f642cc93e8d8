"""Joint readings that no arm can have taken: a message of zeros, a bit that flipped, the first before the driver began.

One of them among 20,000 counts, where what the joints do is not known better than to their acceleration: 0.01 rad for
one sample at 500 Hz is 5000 rad/s^2.
"""

import numpy as np

from ftbias_jax.types import Array

ACCELERATION = 100.0
"""rad/s^2 or m/s^2, more than arms do: a jump is what this, over one interval, does not explain."""
NOISE, USUAL = 8.0, 0.95
"""A jump is so many times the deviation that this share of the steps stays below."""
FINEST, STEPS = 0.05, 5.0
"""Share of the steps that are shorter than those of a coarse encoder, which moves by one at least; a jump is more."""
FASTEST = 0.99
"""Share of the steps that are slower than what is believed of the speed after a jump."""
LONGEST = 0.5
"""s from a jump to the next, at most: what lasts may be true."""
SPAN = 7
"""Steps by the median of which an arm is said to move at the ends of a log."""


def find_glitches(t: Array, q: Array) -> Array:
    """(G,) the rows of joints q (T, n) rad at increasing t (T,) s on which a joint has jumped away.

    They last until it is back where it can have gone meanwhile; those at the beginning or end of a log are few.
    """
    if len(t) < SPAN:
        return np.zeros(0, int)
    interval = float(np.median(np.diff(t)))
    steps = _turned(np.diff(q, axis=0))
    bends = np.abs(np.diff(steps, axis=0)).max(0)
    suspects = np.flatnonzero(bends > ACCELERATION * interval**2)
    return np.unique(np.concatenate([np.zeros(0, int), *(_off(t, steps[:, joint], interval) for joint in suspects)]))


def _off(t: Array, steps: Array, interval: float) -> Array:
    """(G,) the rows on which one joint is off, from its steps (T - 1,) rad at t (T,) s, ``interval`` s apart."""
    took = np.diff(t)
    speeds = steps / np.maximum(took, interval / 2)
    first, last = np.median(speeds[:SPAN]), np.median(speeds[-SPAN:])
    padded = _middle(np.r_[[first] * 3, speeds, [last] * 3])
    before, after = padded[: len(steps)], padded[4:]  # medians of the three steps before each, and after it
    bounds = np.stack([before * took, after * took, before * interval, after * interval])
    low, high = bounds.min(0), bounds.max(0)
    excess = np.maximum(np.maximum(steps - high, low - steps), 0) - (high - low)
    fastest = float(np.quantile(np.abs(speeds), FASTEST))
    excess -= fastest * np.maximum(took - interval, 0)  # where samples were lost, more can have happened
    lengths = np.abs(steps[steps != 0])
    finest = float(np.quantile(lengths, FINEST))
    least = max(ACCELERATION * interval**2, NOISE * float(np.quantile(excess, USUAL)), STEPS * finest)
    q, off, back, speed = np.r_[0.0, np.cumsum(steps)], [], -3, 0.0
    for jump in np.flatnonzero(excess > least):
        if jump < back:
            continue
        speed = before[jump] if jump >= back + 3 else speed  # what is before a second jump is no speed
        rows = np.arange(jump + 1, np.searchsorted(t, t[jump] + LONGEST, "right"))
        gap, later = t[rows] - t[jump], np.clip(np.r_[after, last][rows - 1], -fastest, fastest)
        reach = least + np.abs(speed - later) / 2 * gap
        near = np.abs(_turned(q[rows] - q[jump] - (speed + later) / 2 * gap)) <= reach
        near &= np.r_[near[1:], True]  # one alone may be by chance
        lasts = int(near.argmax()) if near.any() else len(t)
        if jump < lasts and t[jump] - t[0] <= LONGEST:
            off.append(np.arange(jump + 1))
        elif near.any():
            back = rows[lasts]
            off.append(np.arange(jump + 1, back))
        elif t[-1] - t[jump] <= LONGEST:
            off.append(rows)
            break
    return np.concatenate([np.zeros(0, int), *off])


def _turned(angles: Array) -> Array:
    """The angles less whole turns: one that begins anew has not jumped."""
    return angles - 2 * np.pi * np.rint(angles / (2 * np.pi))


def _middle(x: Array) -> Array:
    """Medians of three in a row."""
    a, b, c = x[:-2], x[1:-1], x[2:]
    return np.maximum(np.minimum(a, b), np.minimum(np.maximum(a, b), c))
