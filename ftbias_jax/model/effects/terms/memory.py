"""Drives with a memory: linear recurrences worked out by doubling, by NumPy or JAX alike and at any sample times.

Several logs may stand one after the other: where time goes back another one begins, and nothing is remembered.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ftbias_jax.types import Array


def swing_forgets(frequency: Array, damping_ratio: Array) -> Array:
    """() s, time constant with which a swing of so many Hz, undamped, with this damping ratio dies down."""
    return 1 / (2 * np.pi * frequency * damping_ratio)


def recurrence(xp: Any, decay: Array, kick: Array) -> Array:
    """y_k = decay_k y_(k-1) + kick_k from y_(-1) = 0, by log2(T) passes; decay (T, 1) may be complex, kick (T, k)."""
    step, length = 1, kick.shape[0]
    while step < length:
        kick = xp.concatenate([kick[:step], kick[step:] + decay[step:] * kick[:-step]])
        decay = xp.concatenate([decay[:step], decay[step:] * decay[:-step]])
        step *= 2
    return kick


def low_passed(xp: Any, t: Array, signal: Array, time_constant: Array) -> Array:
    """First-order lag of a signal (T, k) by a time constant () s, at its first value before each log."""
    dt = xp.diff(t, prepend=t[:1])[:, None]
    decay = xp.where(dt < 0, 0.0, xp.exp(-xp.abs(dt) / xp.maximum(time_constant, 1e-6)))
    return signal[:1] + recurrence(xp, decay, (1 - decay) * (signal - signal[:1]))


def swing(xp: Any, t: Array, signal: Array, frequency: Array, damping_ratio: Array) -> Array:
    """Deviation y - u of a mass on spring and damper that the signal u (T, k) carries, at rest before each log.

    The deviation e obeys e'' + 2 zeta w e' + w^2 e = -u''. With u'' as kicks between straight pieces, it is the
    imaginary part of one complex recurrence. The frequency, undamped, is in Hz, the damping ratio from 0 to below 1.
    """
    w = 2 * xp.pi * frequency
    damped = w * xp.sqrt(1 - damping_ratio**2)
    dt = xp.diff(t)[:, None]
    slope = xp.diff(signal, axis=0) / xp.where(dt > 0, dt, xp.inf)
    begins = dt < 0  # another log, of which neither the swing nor the slope goes on
    kick = xp.diff(slope, axis=0, prepend=slope[:1])
    kick = xp.where(begins | xp.concatenate([begins[:1] & False, begins[:-1]]), 0.0, kick)
    rotation = xp.where(begins, 0.0, xp.exp((-damping_ratio * w + 1j * damped) * xp.abs(dt)))
    later = recurrence(xp, xp.concatenate([rotation[:1], rotation[:-1]]), kick + 0j)
    deviation = -(rotation * later).imag / damped
    return xp.concatenate([xp.zeros_like(signal[:1]), deviation])
