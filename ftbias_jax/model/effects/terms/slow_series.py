"""Series of time, temperature and load."""

from __future__ import annotations

from typing import Any

from ftbias_jax.model.effects.terms.memory import low_passed
from ftbias_jax.model.effects.terms.series import Numbers, stack
from ftbias_jax.model.effects.terms.types import State
from ftbias_jax.types import Array


def ones(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """1 at all times."""
    return xp.ones_like(s.t)[:, None]


def exponential(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """A constant, and what decays with a time constant."""
    return stack(xp, xp.ones_like(s.t), xp.exp(-s.t / p["time_constant"]))


def linear_in_time(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """s since the first sample."""
    return s.t[:, None]


def step(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """1 from a time on."""
    return (s.t >= p["time"])[:, None] * 1.0


def wave(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Sine and cosine of a frequency."""
    angle = 2 * xp.pi * p["frequency"] * s.t
    return stack(xp, xp.sin(angle), xp.cos(angle))


def line(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """A sine and a cosine, as they are left in means of evenly spaced samples."""
    step = xp.pi * p["frequency"] * s.period
    fast = xp.abs(xp.sin(step)) > 1e-6
    left = xp.where(fast, xp.sin(s.counts * step) / (s.counts * xp.where(fast, xp.sin(step), 1.0)), 1.0)
    return wave(xp, s, p, joint) * left[:, None]


def powers_of_time(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Time and its square."""
    return stack(xp, s.t, s.t**2)


def _warmer(xp: Any, s: State, p: Numbers) -> Array:
    felt = low_passed(xp, s.t, s.temperature[:, None], p["lag"])
    return felt - felt[:1]


def temperature(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Temperature since the first sample, felt late."""
    return _warmer(xp, s, p)


def temperature_squared(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """The same, and its square."""
    warmer = _warmer(xp, s, p)
    return xp.concatenate([warmer, warmer**2], 1)


def warming_side(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """The part of the tool that follows the thermometer late, and the difference from it: a gradient of temperature."""
    warmer = (s.temperature - s.temperature[0])[:, None]
    felt = _warmer(xp, s, p)
    return xp.concatenate([felt, warmer - felt], 1)


def sensitivity(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """The load times the temperature."""
    return -_warmer(xp, s, p) * s.load


def _off_reference(xp: Any, s: State, p: Numbers) -> Array:
    return low_passed(xp, s.t, s.temperature[:, None], p["lag"]) - p["reference"]


def calibrated(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """The load times how far the temperature is from that of the calibration."""
    return -_off_reference(xp, s, p) * s.load


def compensated(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """The load times the square of that: what a compensation at one temperature leaves."""
    return -(_off_reference(xp, s, p) ** 2) * s.load


def load_squared(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Squares of the reading."""
    return -(s.load**2)


def load_signed(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Squares of the reading with its sign."""
    return -s.load * xp.abs(s.load)


def load_cubed(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Third powers of the reading."""
    return -(s.load**3)


def load_size(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Sizes of the reading."""
    return -xp.abs(s.load)


def load_in_time(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """The reading times the time."""
    return -s.load * s.t[:, None]


def load_settling(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """The reading times what settles with a time constant."""
    return s.load * xp.expm1(-s.t / p["time_constant"])[:, None]


def load_wave(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """The reading times a slow sine."""
    angle = 2 * xp.pi * p["frequency"] * s.t[:, None]
    return -s.load * xp.sin(angle)


def load_step(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """The reading from a time on."""
    return -s.load * (s.t >= p["time"])[:, None]


def noise_of_load(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Square of each channel's load."""
    return s.load**2


def noise_of_force(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Square of the force on the sensor, for all channels."""
    return _alike(xp, (s.load[:, :3] ** 2).sum(1))


def noise_of_time(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Time since the first sample."""
    return _alike(xp, s.t)


def noise_of_acceleration(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Square of the acceleration."""
    return _alike(xp, (s.acceleration**2).sum(1))


def noise_of_speed(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Square of the speed."""
    return _alike(xp, (s.velocity**2).sum(1))


def noise_of_joints(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Sum of the squared speeds of the joints."""
    return _alike(xp, (s.dq**2).sum(1))


def _alike(xp: Any, x: Array) -> Array:
    return xp.broadcast_to(x[:, None], (len(x), 6))
