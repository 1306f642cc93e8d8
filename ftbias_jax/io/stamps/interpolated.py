"""Readings of a slower stream that were linearly interpolated onto the rows of a table, as ``interp`` functions do.

Between two readings all values then lie on one straight line, which noise never does. Taking such rows for readings
overstates the information in a wrench, and joints seem to move without acceleration and to jerk at every reading.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ftbias_jax.io.log import Repair, Repairs
from ftbias_jax.types import Array

WORDS = {"wrench": "the wrench was", "q": "the joints were", "dq": "the velocities were"}
"""Arrays that are examined -> beginning of the report lines about them."""
WINDOW, WINDOWS = 256, (2, 16)
"""Consecutive rows per window, and number of windows examined per log: at first, and if these are inconclusive."""
FEWEST = 3, 30
"""Minimum number of bends in a window that counts, because an arm at rest has none, and in all these together."""
STAMP = 1e-6
"""s, resolution of stamps."""
DECIMALS, DIGITS = np.arange(1, 10), np.arange(4, 10)
"""Decimal places, or significant digits, with which programs write numbers."""
DOUBLE = 16 * np.finfo(float).eps
"""Round-off of sums in double precision, relative to the largest value."""
FEW, WHOLE, SLACK, TINY = 64, 1e-3, 1.05, 1e-30
"""Number of values that show in which format a column was written; tolerance to whole numbers of the last digit; margin
over the deviation from a line that rounding causes; smallest resolution and magnitude."""
STRAIGHT = 0.25
"""Minimum share of rows on straight lines; with fewer, the table is hardly faster than the readings."""
ISOLATED = 0.9
"""Minimum share of bends with at most one neighbouring bend, because a reading lies on a row or between two."""
REGULAR, UNSTEADY = 0.8, 0.25
"""Minimum share of bends at the usual distance, within one row and UNSTEADY of it, because readings are regular."""
CLEAR = 2.0
"""Minimum ratio of the median bend to rounding; bends by noise or by an accelerating arm can be of any size."""
MOVING = 0.5
"""Minimum share of the rows on straight lines along which something changes; if nothing does, readings are held."""


class _Bends(NamedTuple):
    """Deviation of each row (T,) of a table from the line between its neighbours."""

    size: Array
    """Deviation in units of the rounding error, for the column in which it is largest."""
    changes: Array
    """Whether any column changes between this row and the next."""

    @property
    def bent(self) -> Array:
        return self.size > 1


def readings_only(t: Array, columns: Mapping[str, Array]) -> tuple[dict[str, Array], Repairs]:
    """Remove rows that were interpolated between readings from the columns of a log.

    Args:
        t: (T,) increasing, s or ns.
        columns: (T, ...) by the names of a log's arrays, NaN = not measured.

    Returns:
        the columns, NaN where nothing was measured; and one repair for each column with fewer readings.
    """
    kept, repairs = dict(columns), []
    for name in [name for name in WORDS if name in columns]:
        values = np.asarray(columns[name])
        if values.dtype.kind != "f" or values.ndim != 2 or len(values) != len(t):
            continue  # whole numbers have no line between them, and malformed arrays are refused later
        with np.errstate(all="ignore"):  # infinities are refused later
            readings = find_readings(t, values)
        if readings is None:
            continue
        out = np.ones(len(t), bool)
        out[readings] = False
        kept[name] = np.where(out[:, None], np.nan, values)
        rows = np.count_nonzero(~np.isnan(values).any(1))
        what = f"interpolated between readings, {len(readings)} in {rows} rows: those are used"
        repairs.append(Repair(f"{WORDS[name]} {what}"))
    return kept, tuple(repairs)


def find_readings(t: Array, values: Array) -> Array | None:
    """(R,) rows of values (T, k) at t (T,) nearest to the readings between which they are interpolated, or None."""
    measured = np.flatnonzero(~np.isnan(values @ np.ones(values.shape[1])))
    if len(measured) < 2 * WINDOW:
        return None
    bends = _bends(t, values, _some(measured, WINDOWS[0]))
    if bends.bent.sum() > (1 - STRAIGHT) * bends.changes.sum():  # the usual case
        return None
    if not _interpolated(_bends(t, values, _some(measured, WINDOWS[1]))):
        return None
    return measured[_nearest_rows(_bends(t, values, measured))]


def _some(rows: Array, windows: int) -> Array:
    """Rows of ``windows`` evenly spaced windows, or all rows if there are fewer."""
    if len(rows) <= windows * WINDOW:
        return rows
    return rows[np.linspace(0, len(rows) - WINDOW, windows, dtype=int)[:, None] + np.arange(WINDOW)].ravel()


def _interpolated(bends: _Bends) -> bool:
    """Whether the rows of a table lie on straight lines between readings."""
    windows = bends.bent[: len(bends.bent) // WINDOW * WINDOW].reshape(-1, WINDOW)
    informative = np.repeat(windows.sum(1) >= FEWEST[0], WINDOW)
    size, bent, changes = (x[: len(informative)][informative] for x in (bends.size, bends.bent, bends.changes))
    apart = np.diff(np.flatnonzero(bent[1:] & ~bent[:-1]))  # rows between the beginnings of bends
    if bent.sum() < FEWEST[1] or (~bent).mean() < STRAIGHT or not len(apart):
        return False
    usual = np.median(apart)
    return bool(
        changes[~bent].mean() >= MOVING
        and (np.convolve(bent, [1, 1, 1], "same")[bent] <= 2).mean() >= ISOLATED
        and (np.abs(apart - usual) <= 1 + UNSTEADY * usual).mean() >= REGULAR
        and np.median(size[bent]) >= CLEAR
    )


def _nearest_rows(bends: _Bends) -> Array:
    """(R,) row of the largest bend in each group; longer lines are filled with rows at the usual distance."""
    before, after = np.r_[0.0, bends.size[:-1]], np.r_[bends.size[1:], 0.0]
    rows = np.flatnonzero(bends.bent & (bends.size >= before) & (bends.size > after))
    usual = int(np.median(np.diff(rows)))
    # Neither end of a table need be a reading: beyond the last reading, interpolation repeats it.
    first, last = rows[0] % usual, rows[-1] + (len(bends.size) - 1 - rows[-1]) // usual * usual
    rows = np.unique(np.r_[first, rows, last])
    counts = np.maximum(np.diff(rows) // usual, 1)
    between = [a + (b - a) * np.arange(n) // n for a, b, n in zip(rows, rows[1:], counts, strict=False)]
    return np.concatenate([*between, rows[-1:]])


def _bends(t: Array, values: Array, rows: Array) -> _Bends:
    """Bends at the given rows of values (T, k) at t (T,)."""
    values, seconds = values[rows], np.asarray(t[rows] - t[0], float)
    if t.dtype.kind == "i":
        seconds *= 1e-9
    before, after = np.diff(seconds)[:-1, None], np.diff(seconds)[1:, None]
    steps = np.diff(values, axis=0)
    slope = (steps[:-1] + steps[1:]) / (before + after)
    rounding = SLACK * _resolution(values)[1:-1] + STAMP * np.abs(slope)
    size = np.zeros(len(values))
    size[1:-1] = (np.abs(steps[:-1] - slope * before) / rounding).max(1)
    return _Bends(size, np.r_[(steps != 0).any(1), False])


def _resolution(values: Array) -> Array:
    """(T, k) resolution of each value, from the format in which the values (T, k) were written."""
    few = values[np.linspace(0, len(values) - 1, FEW, dtype=int)]
    decimals, digits = 10.0 ** -DECIMALS[:, None, None], 10.0 ** (1 - DIGITS[:, None, None])
    units = np.concatenate([np.broadcast_to(decimals, (len(decimals), *few.shape)), digits * _power(few)])
    lasts = few / units
    written = (np.abs(lasts - np.rint(lasts)) < WHOLE).all(1)  # (units, k)
    single = (few == few.astype(np.float32)).all(0)
    best = np.where(written, units.mean(1), 0).argmax(0)
    finest = np.where(single, np.finfo(np.float32).eps * np.abs(values), DOUBLE * np.abs(values).max(0))
    fixed, floating = np.append(decimals, np.zeros(len(DIGITS))), np.append(np.zeros(len(DECIMALS)), digits)
    unit = fixed[best] + floating[best] * _power(values)
    return np.maximum(np.where(written.any(0), np.maximum(unit, finest), finest), TINY)


def _power(x: Array) -> Array:
    """Largest power of ten that does not exceed the magnitude of each number."""
    return 10.0 ** np.floor(np.log10(np.maximum(np.abs(x), TINY)))
