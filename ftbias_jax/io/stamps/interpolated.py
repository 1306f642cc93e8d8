"""Readings of a slower stream that were interpolated onto the rows of a table, as ``interp`` of most programs does.

Between two readings all values then lie on one straight line, which no noise does. Whoever takes such rows for
readings believes too much of a wrench, and sees joints that move without acceleration and jerk at every reading.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ftbias_jax.io.log import Repair, Repairs
from ftbias_jax.types import Array

WORDS = {"wrench": "the wrench was", "q": "the joints were", "dq": "the velocities were"}
"""Arrays that are looked at, and how lines about them begin."""
WINDOW, WINDOWS = 256, (2, 16)
"""Rows in a row, and how many such windows of a log are looked at, at first and if these leave it open."""
FEWEST = 3, 30
"""Bends of a window from which on it tells, as an arm at rest has none, and of those together."""
STAMP = 1e-6
"""s to which stamps are good."""
DECIMALS, DIGITS = np.arange(1, 10), np.arange(4, 10)
"""After the point, or significant, with which programs write numbers."""
DOUBLE = 16 * np.finfo(float).eps
"""Of the largest, what sums of double precision are good for."""
FEW, WHOLE, SLACK, TINY = 64, 1e-3, 1.05, 1e-30
"""Values by which it is told how a column was written, how near they are to whole numbers of the last digit, and over
the distance from a line that rounding makes."""
STRAIGHT = 0.25
"""Share of rows on straight lines, at least; with fewer, the table is little faster than the readings."""
ISOLATED = 0.9
"""Share of the bends with no more than one beside them, as a reading lies on a row or between two."""
REGULAR, UNSTEADY = 0.8, 0.25
"""Share of the bends that are as far apart as usual, to a row and a share of that: readings are, and chance is not."""
CLEAR = 2.0
"""By which the usual bend exceeds what rounding does: noise, and an arm that accelerates, bend by any amount."""
MOVING = 0.5
"""Share of rows on straight lines along which something changes: where nothing does, readings are held."""


class _Bends(NamedTuple):
    """Of the rows (T,) of a table: how far each is from the line between its neighbours."""

    size: Array
    """In what rounding does, of the column that bends most."""
    changes: Array
    """Whether anything changes on the way to the next row."""

    @property
    def bent(self) -> Array:
        return self.size > 1


def readings_only(t: Array, columns: Mapping[str, Array]) -> tuple[dict[str, Array], Repairs]:
    """The columns of a log without what was interpolated between readings.

    Args:
        t: (T,) increasing, s or ns.
        columns: (T, ...) by the names of a log's arrays, NaN = not measured.

    Returns:
        the columns, NaN where nothing was measured; and a line for each that has become shorter.
    """
    kept, repairs = dict(columns), []
    for name in [name for name in WORDS if name in columns]:
        values = np.asarray(columns[name])
        if values.dtype.kind != "f" or values.ndim != 2 or len(values) != len(t):
            continue  # whole numbers have no line between them, and what is no log is refused later
        with np.errstate(all="ignore"):  # what is infinite is refused later
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
    """(R,) the rows of values (T, k) at t (T,) nearest to the readings between which they are interpolated, or None."""
    measured = np.flatnonzero(~np.isnan(values @ np.ones(values.shape[1])))
    if len(measured) < 2 * WINDOW:
        return None
    bends = _bends(t, values, _some(measured, WINDOWS[0]))
    if bends.bent.sum() > (1 - STRAIGHT) * bends.changes.sum():  # as a rule
        return None
    if not _interpolated(_bends(t, values, _some(measured, WINDOWS[1]))):
        return None
    return measured[_nearest_rows(_bends(t, values, measured))]


def _some(rows: Array, windows: int) -> Array:
    """So many windows of the rows, or all if they are fewer."""
    if len(rows) <= windows * WINDOW:
        return rows
    return rows[np.linspace(0, len(rows) - WINDOW, windows, dtype=int)[:, None] + np.arange(WINDOW)].ravel()


def _interpolated(bends: _Bends) -> bool:
    """Whether the rows of a table lie on straight lines between readings."""
    windows = bends.bent[: len(bends.bent) // WINDOW * WINDOW].reshape(-1, WINDOW)
    tells = np.repeat(windows.sum(1) >= FEWEST[0], WINDOW)
    size, bent, changes = (x[: len(tells)][tells] for x in (bends.size, bends.bent, bends.changes))
    apart = np.diff(np.flatnonzero(bent[1:] & ~bent[:-1]))  # between the beginnings of bends
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
    """(R,) of each group of bends the largest; and where a line is longer, rows on it as far apart as those."""
    before, after = np.r_[0.0, bends.size[:-1]], np.r_[bends.size[1:], 0.0]
    rows = np.flatnonzero(bends.bent & (bends.size >= before) & (bends.size > after))
    usual = int(np.median(np.diff(rows)))
    # Neither end of a table need be a reading: beyond the last one, interpolation repeats it.
    first, last = rows[0] % usual, rows[-1] + (len(bends.size) - 1 - rows[-1]) // usual * usual
    rows = np.unique(np.r_[first, rows, last])
    counts = np.maximum(np.diff(rows) // usual, 1)
    between = [a + (b - a) * np.arange(n) // n for a, b, n in zip(rows, rows[1:], counts, strict=False)]
    return np.concatenate([*between, rows[-1:]])


def _bends(t: Array, values: Array, rows: Array) -> _Bends:
    """Of some rows of values (T, k) at t (T,)."""
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
    """(T, k) by how much each value differs from another at least, as the values (T, k) were written."""
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
    """The power of ten of numbers."""
    return 10.0 ** np.floor(np.log10(np.maximum(np.abs(x), TINY)))
