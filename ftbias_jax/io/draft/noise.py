"""How noisy a sensor is, from stretches of a log in which nothing but noise changes, and how much motion adds."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ftbias_jax.types import Array

QUIET = 1.0
"""s, least length of the stretches that are looked at."""
FEWEST = 20
"""Samples that a stretch must have; where samples are rare, stretches are longer than QUIET."""
MOST = 100
"""Stretches that are looked at in a long log, evenly spread."""
USUAL, QUIETEST = 0.5, 0.1
"""Share of the stretches that are quieter than the one that is taken, at rest and in motion, which makes noise."""
AT_REST = 2e-3
"""rad that the sensor turns at most in a stretch at rest: a tool of 2 kg then weighs on no axis 0.04 N more or less."""
SAME = 1.3
"""A stretch may be this much louder than its two halves. Motion makes it about sixteen times as loud, since the
residual of a cubic grows with the fourth power of the length; noise, also noise smoothed by a filter, hardly at all."""


def quietest_noise(t: Array, wrench: Array, rotations: Array | None = None) -> tuple[list[float], str] | None:
    """(6,) N, Nm: standard deviation of one sample where the log is quietest, to two digits; and where that is.

    From every stretch a cubic in time is subtracted, so that bias, drift and slow motion do not count, but noise that
    a filter in the sensor has made smooth does. Stretches in which the sensor does not turn come first; where there are
    none, what counts as noise must be as large in the halves of the stretches: otherwise it is motion.

    Args:
        t: (T,) s.
        wrench: (T, 6) N, Nm; NaN = not measured.
        rotations: (T, 3, 3) of the sensor in the base frame; None = not known.

    Returns:
        None if there are too few samples, an axis never changes, or the log shows motion and not noise.
    """
    rows = np.isfinite(wrench).all(1)
    t, wrench, turns = t[rows], wrench[rows], None if rotations is None else rotations[rows]
    if len(t) < FEWEST:
        return None
    parts = list(_stretches(t))
    resting = [] if turns is None else [part for part in parts if _turned(turns[part]) < AT_REST]
    # Samples far apart, as of single poses, differ by motion and look like noise.
    usable = resting or [part for part in parts if np.ptp(t[part]) < 2 * QUIET]
    if not usable:
        return None
    usable = usable[:: max(1, len(usable) // MOST)]
    stds, halves = np.array([_about_cubic(t[part], wrench[part]) for part in usable]).swapaxes(0, 1)
    share = USUAL if resting else QUIETEST
    quiet = np.quantile(stds, share, axis=0)
    moves = not resting and (quiet > SAME * np.quantile(halves, share, axis=0)).any()
    if moves or not (quiet > 0).all():
        return None
    where = "of a usual second at rest" if resting else "of the quietest second of the log, never at rest"
    return [float(f"{std:.2g}") for std in quiet], where if rotations is not None else "of the quietest second"


def scatter_in_motion(t: Array, force: Array, rotations: Array, noise_std: Array) -> float | None:
    """N: root mean square over the axes of what scatters beside the noise in the stretches in which the sensor turns.

    About a cubic in time, as the noise is: of the tool's acceleration that is what comes and goes within a second.

    Args:
        t: (T,) s.
        force: (T, 3) N without the tool's weight; NaN = not measured.
        rotations: (T, 3, 3) of the sensor in the base frame.
        noise_std: (3,) N at rest.

    Returns:
        None where the sensor never turns, or samples are too far apart.
    """
    rows = np.isfinite(force).all(1)
    t, force, rotations = t[rows], force[rows], rotations[rows]
    moving = [part for part in _stretches(t) if _turned(rotations[part]) >= AT_REST and np.ptp(t[part]) < 2 * QUIET]
    if not moving:
        return None
    variance = [_squares(t[part], force[part]) / (part.stop - part.start - 4) for part in moving]
    return float(np.sqrt(np.maximum(np.mean(variance, axis=0) - noise_std**2, 0).mean()))


def _stretches(t: Array) -> Iterator[slice]:
    """Stretches of at least QUIET and FEWEST samples, each of which begins at a quarter of the one before."""
    begin = 0
    while (end := max(begin + FEWEST, int(np.searchsorted(t, t[begin] + QUIET)))) <= len(t):
        yield slice(begin, end)
        begin += (end - begin) // 4


def _turned(rotations: Array) -> float:
    """rad between the orientations of a stretch, at most about the largest from its first."""
    return float(np.abs(rotations - rotations[0]).max())


def _about_cubic(t: Array, wrench: Array) -> tuple[Array, Array]:
    """(6,) standard deviation of what a cubic in time leaves of a stretch, and of what two leave of its halves."""
    middle = len(t) // 2
    first, second = (_squares(t[part], wrench[part]) for part in (slice(middle), slice(middle, None)))
    return np.sqrt(_squares(t, wrench) / (len(t) - 4)), np.sqrt((first + second) / (len(t) - 8))


def _squares(t: Array, wrench: Array) -> Array:
    columns = np.vander((t - t[0]) / max(np.ptp(t), 1e-9), 4)
    left = wrench - columns @ np.linalg.lstsq(columns, wrench, rcond=None)[0]
    squares: Array = (left**2).sum(0)
    return squares
