"""Noise of the sensor, and mass and centre of mass of the tool, as estimated from a log alone; and keys of a setup.

Gravity alone determines the tool's mass and centre of mass, and the sign convention of the sensor. Intervals in which
nothing but noise changes show the sensor's noise, and intervals of motion how much motion adds.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.io.check import LOWEST_RATE
from ftbias_jax.io.draft.robot import Keys
from ftbias_jax.setup.dump import MEASURE, Known
from ftbias_jax.setup.recorded import TORQUE_UNITS
from ftbias_jax.setup.rotations import skew
from ftbias_jax.types import Array

LEAST_SAMPLES, MOST_SAMPLES = 6, 5000
OUTLIER = 4.0
"""Scaled median deviations beyond which a sample counts as contact or fast motion, and is left out."""
ROUNDS = 4
MOST_OPEN = 0.1
"""m, maximum standard error of the centre of mass, for a motion that does not constrain it."""
LIGHT = 0.1
"""kg, less than any tool with its mount: a log that shows less has lost the weight before it was recorded."""
CREDIBLE = 0.5
"""Maximum relative standard error of the mass for which the fit is written to a setup."""
NOT_TURNED = (
    "the sensor is not turned in this log, so its weight shows nothing of the tool: ftbias filter takes an unknown "
    "weight as part of the bias of such a log"
)
QUIET = 1.0
"""s, minimum length of the intervals that are examined."""
FEWEST = 20
"""Minimum number of samples per interval; at low rates, intervals are longer than QUIET."""
MOST = 100
"""Number of intervals that are examined in a long log, evenly spread."""
USUAL, QUIETEST = 0.5, 0.1
"""Quantile of the intervals' standard deviations taken as the noise: at rest, and in motion, which adds noise."""
AT_REST = 2e-3
"""rad, maximum rotation of the sensor at rest: the weight of a 2 kg tool then changes by at most 0.04 N per axis."""
FARTHEST, NEAR = 1.0, 0.3
"""m; no tool's centre of mass is farther from its sensor than the first, few are farther than the second."""
SAME = 1.3
"""Maximum ratio of an interval's residual to that of its two halves. Motion makes it about sixteen, since the residual
of a cubic grows with the fourth power of the length; noise, even if smoothed by a filter, hardly changes."""


class ToolEstimate(NamedTuple):
    """Mass and centre of mass of a tool, estimated from a log in which gravity turns in the sensor frame."""

    mass: float
    """kg; negative if the sensor reports the opposite sign."""
    center_of_mass: Array
    """(3,) m, sensor frame."""
    mass_stderr: float
    """kg, for one independent sample per second; for static poses, for as many as their correlation leaves."""
    center_stderr: Array
    """(3,) m, for as many independent samples, from the torques alone; MOST_OPEN at most."""
    residual: float
    """N, rms residual of the forces after weight and a constant bias."""
    turn: float
    """rad, rotation of gravity in the sensor frame between the poses that are farthest apart along one axis."""

    @property
    def credible(self) -> bool:
        """Whether the motion determines the mass at all."""
        return bool(self.mass_stderr < CREDIBLE * abs(self.mass))

    @property
    def absent(self) -> bool:
        """Whether the motion shows no weight although it could, or one of the wrong sign, left by a compensation."""
        return self.heaviest < LIGHT and not (self.credible and self.mass > 0)

    @property
    def heaviest(self) -> float:
        """kg, upper limit of the tool's mass: three standard errors above the estimate."""
        return abs(self.mass) + 3 * self.mass_stderr


def weigh(
    t: Array, rotations: Array, gravity: Array, wrench: Array, rezeroed_at: Sequence[float] = ()
) -> ToolEstimate | None:
    """Estimate the tool's mass and centre of mass by least squares, as if all samples were at rest, rejecting outliers.

    Args:
        t: (T,) s.
        rotations: (T, 3, 3) sensor frame in the base frame.
        gravity: (3,) m/s^2, base frame.
        wrench: (T, 6) N, Nm, as the sensor reports it.
        rezeroed_at: s, times at which the sensor was zeroed; the bias is constant in between.

    Returns:
        the estimate; None if there are not enough samples, or the sensor is never turned.
    """
    rows = usable_rows(rotations, wrench)
    if len(rows) < LEAST_SAMPLES:
        return None
    whole = -np.einsum("tji,j->ti", rotations[rows], gravity)  # force that supports one kilogram, sensor frame
    # An axis that is not measured tells nothing: zeros in it agree with any tool.
    axes = np.isfinite(wrench[rows[0]])
    force, torque = (np.where(axes[own], wrench[rows, own], 0.0) for own in (slice(0, 3), slice(3, 6)))
    support = whole * axes[:3]
    kept = np.ones(len(rows), bool)
    piece = np.searchsorted(np.sort(rezeroed_at), t[rows])
    for _ in range(ROUNDS):
        swing = _about_means(support[kept], piece[kept])
        turned = (swing**2).sum()
        if turned < len(swing) * 1e-4 * (gravity**2).sum():
            return None
        mass = (swing * _about_means(force[kept], piece[kept])).sum() / turned
        error = force - mass * support
        for number in np.unique(piece):
            at = piece == number
            error[at] -= np.median(error[at & kept] if (at & kept).any() else error[at], 0)
        along = (error[1:] * error[:-1])[kept[1:] & kept[:-1]].sum() / max((error[kept] ** 2).sum(), 1e-300)
        error = np.linalg.norm(error, axis=1)
        kept = error < OUTLIER * 1.4826 * np.median(error) + 1e-9
    residual = float(np.sqrt((error[kept] ** 2).mean()))
    seconds = max(1.0, np.ptp(t[rows]) * kept.mean())
    if np.median(np.diff(t)) * LOWEST_RATE >= 1:  # static poses, between which the bias may drift
        seconds = max(1.0, kept.sum() * (1 - max(along, 0)) / (1 + max(along, 0)))
    stderr = residual / np.sqrt(turned / len(swing) * seconds)
    arms, torques = (_about_means(x[kept], piece[kept]) for x in (whole, torque))
    moment, moment_stderr = _first_moment(arms, torques, seconds, axes[3:])
    center = moment / mass
    center_stderr = np.minimum(np.hypot(moment_stderr, center * stderr) / abs(mass), MOST_OPEN)
    turn = 2 * np.arcsin(min(1.0, np.ptp(whole[kept], axis=0).max() / 2 / np.linalg.norm(gravity)))
    return ToolEstimate(float(mass), center, float(stderr), center_stderr, residual, float(turn))


def usable_rows(rotations: Array, wrench: Array) -> Array:
    """Rows at which orientation and wrench are known, every so many of them: about MOST_SAMPLES.

    Axes without any reading are not waited for.
    """
    measured, oriented = np.isfinite(wrench), np.isfinite(rotations).all((1, 2))
    complete = np.flatnonzero((measured | ~measured.any(0)).all(1) & measured.any(1) & oriented)
    return complete[:: max(1, len(complete) // MOST_SAMPLES)]


def _about_means(values: Array, piece: Array) -> Array:
    """(T, 3) values minus their mean in each piece (T,) of the log."""
    counts = np.bincount(piece)
    means = np.stack([np.bincount(piece, column) for column in values.T], 1) / np.maximum(counts, 1)[:, None]
    return values - means[piece]


def _first_moment(support: Array, torque: Array, count: float, axes: Array) -> tuple[Array, Array]:
    """(3,) m c of torque = (m c) x support + constant, by slightly regularised least squares; and standard errors.

    ``support`` (T, 3), the force that supports one kilogram, and ``torque`` (T, 3) Nm are relative to their means;
    ``count`` samples are independent; torques about the other ``axes`` (3,) bool are not measured.
    """
    if not axes.any():
        return np.zeros(3), np.full(3, np.inf)
    columns = (-skew(support) * axes[:, None]).reshape(-1, 3)
    pull = 1e-6 * np.trace(columns.T @ columns) * np.eye(3)
    target = torque.ravel()
    moment = np.linalg.solve(columns.T @ columns + pull, columns.T @ target)
    variance = ((target - columns @ moment) ** 2).sum() / axes.sum() / count
    return moment, np.sqrt(variance * np.diag(np.linalg.inv(columns.T @ columns + pull)))


def tool_keys(found: ToolEstimate | None, is_stated: bool) -> tuple[Keys, list[str]]:
    """Keys of a setup for the tool, and lines for the user; ``found`` None = the log does not turn the sensor.

    If the setup states the tool's mass, a missing weight is left to ``check``.
    """
    if found is None:
        return {}, [NOT_TURNED]
    if found.absent and not is_stated:
        why = (
            f"the sensor turns by {np.degrees(found.turn):.0f} degrees, and the forces show at most "
            f"{found.heaviest:.2g} kg: the controller subtracts the payload, or there is no tool"
        )
        return {"sensor.compensated": Known("tool", why)}, [why]
    words = (
        f"{abs(found.mass):.3g} \u00b1 {found.mass_stderr:.2g} kg, which leaves {found.residual:.2g} N of the forces"
    )
    if not found.credible:
        return {}, [f"the weight that the log shows is not credible: {words}"]
    remark = f"by its weight in the log; {MEASURE}"
    keys = {
        "tool.mass": Known(float(f"{abs(found.mass):.4g}"), f"\u00b1 {found.mass_stderr:.2g} {remark}"),
        "tool.center_of_mass": Known([round(float(x), 4) for x in found.center_of_mass], remark),
        "tool.mass_std": Known(float(f"{found.mass_stderr:.2g}"), "for the error bars"),
        "tool.center_of_mass_std": Known([float(f"{x:.2g}") for x in found.center_stderr], "for the error bars"),
    }
    distance, notes = float(np.linalg.norm(found.center_of_mass)), list[str]()
    if distance > FARTHEST:
        del keys["tool.center_of_mass"], keys["tool.center_of_mass_std"]
        unit = next((f'"{unit}"' for unit in ("Ncm", "Nmm") if distance * TORQUE_UNITS[unit] < NEAR), "of another unit")
        notes = [
            f"the torques put the centre of mass {distance:.2g} m from the sensor, so they are not in Nm, or the "
            f"forces not in N: state log.torque_unit (perhaps {unit}) or log.force_unit, and correct noise_std"
        ]
    if found.mass < 0:
        why = "because the weight has the opposite sign; not if the base hangs upside down (robot.gravity up instead)"
        keys["sensor.reports"] = Known("wrench_on_sensor", why)
        words += "; its sign is the opposite of the usual one, or the base hangs upside down: see sensor.reports"
    return keys, [f"weighed by the log: {words}", *notes]


def quietest_noise(t: Array, wrench: Array, rotations: Array) -> tuple[list[float], str] | None:
    """(6,) N, Nm: standard deviation of one sample where the log is quietest, to two digits; and where that is.

    A cubic in time is subtracted from every interval, which removes bias, drift and slow motion, but not noise that a
    filter in the sensor has smoothed. Intervals in which the sensor does not turn are preferred; if there are none, the
    noise must be as large in the halves of the intervals: otherwise it is motion.

    Args:
        t: (T,) s.
        wrench: (T, 6) N, Nm; NaN = not measured.
        rotations: (T, 3, 3) of the sensor in the base frame; NaN = not known.

    Returns:
        the noise, of an axis without readings that of its neighbours; None if there are too few samples, a force or
        torque has no axis that changes, or the log shows motion and not noise.
    """
    axes = np.isfinite(wrench).any(0)
    rows = np.isfinite(wrench[:, axes]).all(1)
    t, wrench, rotations = t[rows], wrench[rows][:, axes], rotations[rows]
    if len(t) < FEWEST or not axes.reshape(2, 3).any(1).all():
        return None
    parts = list(_stretches(t))
    resting = [part for part in parts if _turned(rotations[part]) < AT_REST]
    # Samples far apart in time, as of single poses, differ by motion, which looks like noise.
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
    every = np.full(6, np.nan)
    every[axes] = quiet
    every = np.where(axes, every, np.repeat(np.nanmean(every.reshape(2, 3), 1), 3))
    return [float(f"{std:.2g}") for std in every], where


def scatter_in_motion(t: Array, force: Array, rotations: Array, noise_std: Array) -> float | None:
    """N: root mean square over the axes of the scatter beyond the noise in the intervals in which the sensor turns.

    As for the noise, a cubic in time is subtracted: of the tool's acceleration, changes within a second remain.

    Args:
        t: (T,) s.
        force: (T, 3) N without the tool's weight; NaN = not measured.
        rotations: (T, 3, 3) of the sensor in the base frame.
        noise_std: (3,) N at rest.

    Returns:
        the scatter; None if the sensor never turns, or samples are too far apart.
    """
    rows = np.isfinite(force).all(1)
    t, force, rotations = t[rows], force[rows], rotations[rows]
    moving = [part for part in _stretches(t) if _turned(rotations[part]) >= AT_REST and np.ptp(t[part]) < 2 * QUIET]
    if not moving:
        return None
    variance = [_squares(t[part], force[part]) / (part.stop - part.start - 4) for part in moving]
    return float(np.sqrt(np.maximum(np.mean(variance, axis=0) - noise_std**2, 0).mean()))


def _stretches(t: Array) -> Iterator[slice]:
    """Overlapping intervals of at least QUIET s and FEWEST samples, each shifted by a quarter of the last."""
    begin = 0
    while (end := max(begin + FEWEST, int(np.searchsorted(t, t[begin] + QUIET)))) <= len(t):
        yield slice(begin, end)
        begin += (end - begin) // 4


def _turned(rotations: Array) -> float:
    """rad, about the maximum rotation between the first and any other orientation of an interval."""
    return float(np.abs(rotations - rotations[0]).max())


def _about_cubic(t: Array, wrench: Array) -> tuple[Array, Array]:
    """(6,) residual standard deviation of a cubic in time over an interval, and of one over each of its halves."""
    middle = len(t) // 2
    first, second = (_squares(t[part], wrench[part]) for part in (slice(middle), slice(middle, None)))
    return np.sqrt(_squares(t, wrench) / (len(t) - 4)), np.sqrt((first + second) / (len(t) - 8))


def _squares(t: Array, wrench: Array) -> Array:
    columns = np.vander((t - t[0]) / max(np.ptp(t), 1e-9), 4)
    left = wrench - columns @ np.linalg.lstsq(columns, wrench, rcond=None)[0]
    return (left**2).sum(0)
