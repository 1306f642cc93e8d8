"""Rows of a table: static poses or a motion, the unit of their stamps, and the unit of their angles."""

import numpy as np

from ftbias_jax.io.check import HIGHEST_RATE, LOWEST_RATE
from ftbias_jax.io.stamps.clock import seconds_of_a_unit
from ftbias_jax.io.tables.poses import FEWEST, MOST
from ftbias_jax.setup.recorded import TIME_UNITS
from ftbias_jax.types import Array

CENTURY = (9.4e8, 4.1e9)
"""s since 1970: stamps of a clock that is set lie between 2000 and 2100."""
LONGEST_RUN = 1e8
"""s, maximum stamp of other clocks, which start with the computer."""
FASTEST = 3.0
"""rad/s, median speed from row to row that no log of motion exceeds, because none turns so fast all the time."""
APART = 0.05
"""rad, median rotation from row to row; without stamps, rows that are closer are those of a motion."""
MOST_ANGLE = 7.0
"""rad, largest angle of an axis-angle or of roll, pitch and yaw: a little more than a turn."""


def in_degrees(angles: Array | None) -> bool:
    """Whether angles, of an axis-angle or of roll, pitch and yaw, must be in degrees; None = there are none."""
    angles = np.zeros(0) if angles is None else np.asarray(angles, float)
    return bool(np.abs(angles[np.isfinite(angles)]).max(initial=0.0) > MOST_ANGLE)


def is_static(time: Array | None, motion: Array | None) -> bool:
    """Whether rows can be static poses: few, and far apart in time, or in angle if the unit of time is uncertain.

    The stamps (N,) are as stored, the motion (N, ...) joints or orientations; None = there are none.
    """
    if motion is None or motion.ndim < 2 or not FEWEST <= len(motion) <= MOST:
        return False
    if time is not None and len(time) != len(motion):
        return False
    rows = np.reshape(motion, (len(motion), -1))
    rows = rows * (np.pi / 180 if np.abs(rows[np.isfinite(rows)]).max(initial=0.0) > 4 * np.pi else 1.0)
    turns = np.linalg.norm(np.diff(rows, axis=0), axis=1)
    turn = float(np.median(turns[np.isfinite(turns)])) if np.isfinite(turns).any() else 0.0
    if time is None:
        return turn > APART
    step, unit = float(np.median(np.diff(time))), time_unit(time)
    if step * seconds_of_a_unit(time) * LOWEST_RATE <= 1:
        return False
    return not unit or turn > FASTEST * step * TIME_UNITS[unit] * 1e-9


def time_unit(t: Array) -> str:
    """Unit of stamps, if it is not the usual one; "" = the usual one, s, or ns for integers.

    A unit is plausible with the rate of a sensor, and with a date of this century or else a few years of uptime.
    """
    t = np.asarray(t, np.float64) if np.asarray(t).dtype.kind == "f" else np.asarray(t, np.int64)
    steps = np.diff(t)
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
    usual = "ns" if t.dtype.kind == "i" else "s"
    units = (usual, *(other for other in TIME_UNITS if other != usual))
    lengths = {unit: TIME_UNITS[unit] * 1e-9 for unit in units}
    plausible = [unit for unit in units if LOWEST_RATE <= 1 / (step * lengths[unit]) <= HIGHEST_RATE]
    starts = {unit: abs(float(t[0])) * lengths[unit] for unit in plausible}
    dated = [unit for unit, start in starts.items() if CENTURY[0] < start < CENTURY[1]]
    running = [unit for unit, start in starts.items() if start < LONGEST_RUN]
    unit = next(iter(dated + running), usual)
    return "" if unit == usual else unit
