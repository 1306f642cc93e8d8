"""Stamps and angles in the units that the setup states."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ftbias_jax.setup.recorded import FORCE_UNITS, TIME_UNITS, TORQUE_UNITS, LogSetup
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

STANDARD_GRAVITY = 9.80665
"""m/s^2: the unit g of accelerometers."""
EXACT = 2**53
"""Integers up to here are exact as floating-point numbers."""


def stamps(t: Array, log: LogSetup) -> Array:
    """(T,) stamps as floating point in s or integers in ns, from the unit that the setup states.

    Whole numbers of a small unit, such as microseconds since 1970, become integers: their nanoseconds do not fit a
    floating-point number.
    """
    t = np.asarray(t)
    if log.time_unit is None or t.dtype.kind not in "fiu":
        return t
    unit = TIME_UNITS[log.time_unit]
    if t.dtype.kind == "f":
        finite = t[np.isfinite(t)]
        whole = log.time_unit != "s" and len(finite) == len(t) and (finite == np.rint(finite)).all()
        if not whole or np.abs(finite).max(initial=0) > min(EXACT, 2**63 // unit):
            return t * (unit * 1e-9)
    return t.astype(np.int64) * unit


def later(t: Array, seconds: float) -> Array:
    """(T,) stamps, floating point in s or integers in ns, moved by so many seconds."""
    return t + (round(seconds * 1e9) if t.dtype.kind == "i" else seconds)


def rows_at_rate(values: Array, log: LogSetup) -> Array | None:
    """(T,) s of the samples (T, ...) that have a rate instead of stamps; None where the setup states none."""
    return None if log.rate is None else np.arange(len(np.atleast_1d(values))) / log.rate


def recorded_times(arrays: Mapping[str, Array], log: LogSetup) -> Array:
    """(T,) stamps of a log with one clock, from its "t", or by the rate that the setup states instead."""
    counted = rows_at_rate(arrays["wrench"], log)
    return stamps(arrays["t"], log) if counted is None else counted


def angles(values: Array, setup: Setup) -> Array:
    """(T, n) positions or velocities of joints in rad; what slides stays in m."""
    if setup.log.angle_unit == "rad" or setup.pose is not None:
        return values
    turns = np.abs(setup.robot.screws[:, 3:]).sum(1) > 0
    factors: Array = np.where(turns, np.pi / 180, 1.0)
    return values * factors


def wrenches(values: Array, setup: Setup) -> Array:
    """(T, 6) recorded wrenches in N and Nm, with the sign of the report."""
    scale = np.repeat([FORCE_UNITS[setup.log.force_unit], TORQUE_UNITS[setup.log.torque_unit]], 3)
    with np.errstate(invalid="ignore"):  # a damaged file may have NaN of the kind that raises
        return values * (-scale if setup.sensor.reports == "wrench_on_sensor" else scale)
