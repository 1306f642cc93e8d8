"""The noise of single samples: what a filter takes, and what the scatter of its log shows."""

from __future__ import annotations

import numpy as np

from ftbias_jax.filtering import bias_filter
from ftbias_jax.filtering.adapt.vibration import Vibration
from ftbias_jax.filtering.bias_filter import white_share
from ftbias_jax.model.motion_noise import MotionNoise
from ftbias_jax.model.params import Params
from ftbias_jax.types import Array


def sample_variance(stated: Params, found: Vibration | None, variance: Array, velocity: Array) -> Array:
    """Diagonal of R that the filter takes: (T, 6) N^2, Nm^2, without correlated noise; never less than is stated.

    Args:
        stated: parameters that ``found`` was found with.
        found: noise of the log; None = nothing.
        variance: (T, 6) N^2, Nm^2, diagonal of R for ``stated``.
        velocity: (T, n) rad/s.
    """
    if found is None or not found.taken:
        return variance
    sensor = np.asarray(stated.bias.wrench_variance)
    taken = variance + (sensor_level(found) - 1) * sensor + _growth(stated, found, velocity)
    return np.asarray(taken, variance.dtype)


def shown_variance(stated: Params, found: Vibration | None, variance: Array, velocity: Array) -> Array:
    """The same as the scatter of the log shows it, which may be less; arguments as for ``sample_variance``.

    The bias and its error bars rest on what is stated, at least. What the next reading may be is another question, and
    the log answers it: at rest, for one, the joints add less noise than in the motion that sets theirs.
    """
    if found is None:
        return variance
    sensor, shares = np.asarray(stated.bias.wrench_variance), found.shares
    shaking = stated_shaking(stated, velocity)
    # An effect of the setup may make the sensor quieter: there is then nothing beside it, and not less than nothing.
    parts = shares.sensor * sensor + shares.rest * np.maximum(variance - sensor - shaking, 0)
    return np.asarray(parts + _growth(stated, found, velocity), variance.dtype)


def stated_shaking(params: Params, velocity: Array) -> Array:
    """(T, 6) N^2, Nm^2: white vibration that the setup states, at the velocities (T, n) rad/s."""
    motion = bias_filter.vibration(params.bias, velocity)
    return np.zeros((len(velocity), 6)) if motion is None else np.asarray(white_share(params.bias, motion))


def _growth(stated: Params, found: Vibration, velocity: Array) -> Array:
    """(T, 6) N^2, Nm^2: white vibration that the log shows."""
    motion = MotionNoise(found.per_speed, found.speed).variance(velocity)
    return np.asarray(white_share(stated.bias, motion))


def sensor_level(found: Vibration) -> Array:
    """(6,) variance of the sensor that the filter takes, in what is stated: never less.

    On recorded logs with less noise than stated, a filter that believes it gives up more of the readings and claims to
    know the bias better than it does.
    """
    level: Array = np.maximum(found.level, 1)
    return level
