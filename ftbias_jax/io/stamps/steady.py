"""Recovery of the steady clock of regular readings whose stamps jitter: times of arrival, of packets, or rounded ones.

No reading is taken after its stamp of arrival, and the next is taken no sooner than one period later: together all
stamps bound the time of each reading from above, and the bound is nearly steady as soon as some messages arrive without
delay. The readings decide whether they were taken then or at their stamps (a loop that is woken late stamps correctly):
moving joints are smooth in time on the right clock. A wrench often does not decide it, but bunched messages do.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.io.log import Repair, Repairs
from ftbias_jax.io.rates import find_held
from ftbias_jax.io.stamps.clock import one_a_stamp
from ftbias_jax.types import Array

LEAST_SAMPLES = 256
WORDS = {"q": "the joints", "wrench": "the wrench"}
"""Arrays whose readings show whether rows are of several clocks -> their names in messages about a stream."""
SCATTER = 0.02
"""Share of the usual interval below which jitter is negligible. Intervals with lost samples count as several."""
SPANS = ((16, 0.5), (16, 0.3), (64, 0.5))
"""Initial guesses of the period: length of a span in samples, and quantile of the durations of such spans. Lost samples
make spans longer, and packets make short ones vary. The readings decide which guess is best."""
ROUNDS, FAR = 4, 256
"""Iterations of counting lost samples and fitting the period, and number of samples over which the fit is precise."""
SLACK = 1e-3
"""Share of the period by which readings may be closer, because clocks wander and distant stamps must not count."""
REACH = 32
"""Samples on each side over which the bound is smoothed, because it touches only some of the stamps."""
CONFIRMED = 4
"""Samples that must follow a lost one: a sample that is only late is followed by others in time."""
PAUSE = 100
"""Periods without a sample, after which a clock may start anew."""
WINDOW, DEGREE = 24, 3
"""Consecutive samples per window, and degree of the polynomial in time that joints follow within it."""
FASTEST, FEWEST = 0.25, 16
"""Share, and minimum number, of windows with jitter that are examined: those in which a column changes most."""
TINY = 1e-12
ALIKE = 0.95
"""Share of these windows that are used: in the others a quaternion may change its sign, or an angle wrap around. Also
the share of samples in common rows from which two columns are of one stream."""
CLEAR = 5.0
"""Standard errors by which residuals must decrease. The logarithm of a mean of n squares of noise has a variance of
2/n, the difference of two independent ones twice that."""
CLOSE, BUNCHED = 0.25, 0.0005
"""Share of the mean interval below which no sensor takes two readings, and share of such intervals above which messages
waited and arrived together. The readings then need not confirm the steady clock, only not contradict it."""


class Steady(NamedTuple):
    """Corrected stamps of a stream, none of them later than recorded."""

    t: Array
    """(T,) s."""
    gain: float
    """Increase in the smoothness of the readings in time, in standard errors; see ``CLEAR``."""


def scatters(t: Array) -> bool:
    """Whether stamps (T,), in s or ns, are less regular than those of a good recorder."""
    if len(t) < LEAST_SAMPLES:
        return False
    intervals = np.diff(t) / ((t[-1] - t[0]) / (len(t) - 1))
    intervals /= np.median(intervals[intervals > SCATTER])  # in packets, all other intervals are very short
    return bool((np.abs(intervals - np.maximum(np.rint(intervals), 1)) > SCATTER).any())


def on_steady_clocks(
    t: Array, columns: Mapping[str, Array], file: str = ""
) -> tuple[list[tuple[Array, dict[str, Array]]], Repairs]:
    """Streams of a log, with the stamps of a steady clock where the readings are clearly smoother on it.

    Args:
        t: (T,) increasing, s if floating point or ns if integer.
        columns: (T, ...) by the names of a log's arrays, NaN = not measured.
        file: the name in messages.

    Returns:
        stamps and columns of each stream, or of all unchanged; and one repair for each corrected stream.

    Raises:
        LogError: a column does not have one sample of real numbers per stamp.
    """
    if not scatters(t):
        return [(t, dict(columns))], ()
    columns = {name: one_a_stamp(values, len(t), name, file) for name, values in columns.items()}
    ticks = 1e9 if t.dtype.kind == "i" else 1.0
    streams = [(rows, names, (t[rows] - t[0]) / ticks) for rows, names in _streams(columns)]
    clocks = [_look(stamps, columns, rows, names) for rows, names, stamps in streams]
    found = [(clock, stamps) for clock, (_, _, stamps) in zip(clocks, streams, strict=True) if clock is not None]
    if not any(clock.gain > (-CLEAR if _bunched(stamps) else CLEAR) for clock, stamps in found):
        return [(t, dict(columns))], ()
    parts, repairs = [], []
    for clock, (rows, names, stamps) in zip(clocks, streams, strict=True):
        times = t[rows]
        # A stream recorded beside a late one is late as well, even if its readings do not decide it.
        if clock is not None and clock.gain > -CLEAR:
            ahead = clock.t * ticks
            times = t[0] + (np.rint(ahead).astype(np.int64) if t.dtype.kind == "i" else ahead)
            which = " and ".join(word for name, word in WORDS.items() if name in names) or " ".join(names)
            what = f"stamps of {which} up to {1e3 * np.max(stamps - clock.t):.2g} ms late"
            repairs.append(Repair(f"{what}: those of the steady clock behind them are used"))
        parts.append((times, {name: columns[name][rows] for name in names}))
    return parts, tuple(repairs)


def _streams(columns: Mapping[str, Array]) -> Iterator[tuple[Array, list[str]]]:
    """(T,) mask of the rows of each stream, and its columns: those that share most of their rows."""
    rows = {name: ~np.isnan(values.reshape(len(values), -1)).all(1) for name, values in columns.items()}
    temperature = rows.pop("temperature", None)
    left = sorted(rows, key=lambda name: -int(rows[name].sum()))
    while left:
        first = left[0]
        names = [name for name in left if (rows[name] & rows[first]).sum() >= ALIKE * rows[name].sum()]
        left = [name for name in left if name not in names]
        stream = np.any([rows[name] for name in names], 0)
        if temperature is not None and (temperature & stream).sum() >= ALIKE * min(temperature.sum(), stream.sum()):
            names, temperature = [*names, "temperature"], None  # temperatures in rows of other streams are not needed
        yield stream, names
    if temperature is not None:
        yield temperature, ["temperature"]


def _look(t: Array, columns: Mapping[str, Array], rows: Array, names: Sequence[str]) -> Steady | None:
    """The steady clock of a stream with stamps t (T,) s; None if they do not jitter, or may be of several clocks."""
    if not scatters(t):
        return None
    readings = {name: columns[name][rows].reshape(len(t), -1) for name in names}
    # Rows where readings are held may be a table in which each stream repeats its last reading.
    if any(find_held(readings[name]) for name in WORDS.keys() & readings.keys()):
        return None
    return steady(t, np.concatenate(list(readings.values()), 1))


def _bunched(t: Array) -> bool:
    """Whether stamps (T,) are so close together that no sensor took the readings then; see ``BUNCHED``."""
    gaps = np.diff(t)
    return bool((gaps < CLOSE * gaps.mean()).mean() > BUNCHED)


def steady(t: Array, readings: Array) -> Steady:
    """The steady clock on which readings (T, k), NaN = not measured, with increasing stamps t (T,) s are smoothest."""
    gaps = np.diff(t)
    pieces = np.split(t, np.flatnonzero(gaps > PAUSE * gaps.mean()) + 1)
    clocks = (np.concatenate([_bound(piece, *guess) for piece in pieces]) for guess in SPANS)
    least = SCATTER * float(gaps.mean())
    judged = (_judged(np.maximum.accumulate(clock), t, readings, least) for clock in clocks)
    return max((one for one in judged if one is not None), key=lambda one: one.gain, default=Steady(t, 0.0))


def _judged(clock: Array, t: Array, readings: Array, least: float) -> Steady | None:
    """A clock (T,) s with its gain over the stamps t (T,) s; None if both agree to ``least`` s in every window."""
    windows = _informative_windows(readings, t - clock, least)
    if not windows.size:
        return None
    smoother = np.log(_roughness(t, readings, windows) / _roughness(clock, readings, windows)).sum()
    return Steady(clock, float(smoother / (2 * np.sqrt(readings.shape[1] / windows.size))))


def _bound(t: Array, samples: int, quantile: float) -> Array:
    """(T,) s: the latest times at which readings a period apart, some of them lost, can have been taken."""
    if len(t) <= 2 * samples:
        return t
    none_lost = count = np.arange(len(t))
    period = float(np.quantile(t[samples:] - t[:-samples], quantile)) / samples
    for _ in range(ROUNDS):
        steps = np.maximum(np.rint(np.diff(_latest(t, none_lost, period)) / period), 1)
        steps[-CONFIRMED:] = 1  # the last ones may be late
        count = np.concatenate([[0], np.cumsum(steps)])
        far = min(FAR, len(t) // 2)
        period = float(np.median((t[far:] - t[:-far]) / (count[far:] - count[:-far])))
    latest = _latest(t, count, period)
    # No later stamp bounds the last ones: there, the clock is taken to be no slower than before.
    line = count[-far:] * period * (1 + SLACK)
    latest[-far:] = np.minimum.accumulate(latest[-far:] - line) + line
    line = count * period
    return _smooth(latest - line) + line


def _smooth(x: Array) -> Array:
    """(T,) moving average over REACH samples on each side, fewer at the ends."""
    sums = np.concatenate([[0.0], x.cumsum()])
    here = np.arange(len(x))
    reach = np.minimum(REACH, np.minimum(here, here[::-1]))
    return (sums[here + reach + 1] - sums[here - reach]) / (2 * reach + 1)


def _latest(t: Array, count: Array, period: float) -> Array:
    """(T,) s, latest times: no reading after its stamp, nor sooner after the previous one than a period minus slack."""
    line = count * period * (1 - SLACK)
    return np.minimum.accumulate((t - line)[::-1])[::-1] + line


def _informative_windows(readings: Array, off: Array, least: float) -> Array:
    """(K, WINDOW) samples of windows in which ``off`` (T,) s varies by over ``least`` s and a column changes most."""
    samples = np.arange(len(off) // WINDOW * WINDOW).reshape(-1, WINDOW)
    samples = samples[np.ptp(off[samples], axis=1) > least]
    moved = np.nan_to_num(np.ptp(readings[samples], axis=1))
    share = (moved / np.maximum(moved.max(0, initial=0), TINY)).max(1, initial=0)
    return samples[np.argsort(-share)[: max(FEWEST, int(FASTEST * len(share)))]]


def _roughness(t: Array, readings: Array, windows: Array) -> Array:
    """(k,) mean square residual of polynomials in time, over the ALIKE share of the windows (K, WINDOW)."""
    values, places = readings[windows], t[windows]
    places = places - places.mean(1, keepdims=True)
    places = places / np.maximum(np.abs(places).max(1, keepdims=True), TINY)
    basis, _ = np.linalg.qr(places[..., None] ** np.arange(DEGREE + 1))
    left = values - basis @ (np.swapaxes(basis, 1, 2) @ values)
    squares = np.sort((left**2).mean(1), 0)
    rough = squares[: int(np.ceil(ALIKE * len(squares)))].mean(0)
    return np.where(np.isfinite(rough) & (rough > 0), rough, 1.0)
