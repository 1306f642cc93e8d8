"""What a log shows of sensor and tool by itself, and keys of a setup.

Gravity alone shows the tool's mass and centre of mass, and the sign of the reports; stretches in which nothing but
noise changes show how noisy the sensor is, and how much motion adds.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.io.check import LOWEST_RATE
from ftbias_jax.io.draft.robot import Keys
from ftbias_jax.setup.dump import MEASURE, Known
from ftbias_jax.setup.rotations import skew
from ftbias_jax.types import Array

LEAST_SAMPLES, MOST_SAMPLES = 6, 5000
OUTLIER = 4.0
"""Scaled median deviations beyond which a sample is contact or fast motion, and left out."""
ROUNDS = 4
MOST_OPEN = 0.1
"""m: of a centre that the motion does not show, that much is not known."""
LIGHT = 0.1
"""kg: tools are heavier, with what holds them, so that a log which shows less has lost the weight on the way."""
CREDIBLE = 0.5
"""Standard error of the mass, as a share of it, up to which the fit is worth writing down."""
NOT_TURNED = (
    "the sensor is not turned in this log, so its weight shows nothing of the tool: ftbias filter takes an unknown "
    "weight as part of the bias of such a log"
)
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


class Weighed(NamedTuple):
    """A tool that was weighed by turning it."""

    mass: float
    """kg; negative if the sensor reports the opposite sign."""
    center_of_mass: Array
    """(3,) m, sensor frame."""
    mass_stderr: float
    """kg, as if one sample a second were independent, and of static poses as many as their correlation leaves."""
    center_stderr: Array
    """(3,) m, the same, of the torques alone; MOST_OPEN at most."""
    residual: float
    """N, rms of what weight and a constant bias leave of the forces."""
    turn: float
    """rad by which gravity turns, as seen from the sensor, between the poses that are farthest apart along one axis."""

    @property
    def credible(self) -> bool:
        """Whether the motion determines the mass at all."""
        return bool(self.mass_stderr < CREDIBLE * abs(self.mass))

    @property
    def absent(self) -> bool:
        """Whether the motion shows no weight, although it would, or one of the wrong sign, left by a compensation."""
        return self.heaviest < LIGHT and not (self.credible and self.mass > 0)

    @property
    def heaviest(self) -> float:
        """kg that the tool may have, three standard errors above what was found."""
        return abs(self.mass) + 3 * self.mass_stderr


def weigh(
    t: Array, rotations: Array, gravity: Array, wrench: Array, rezeroed_at: Sequence[float] = ()
) -> Weighed | None:
    """Weigh the tool by least squares, as if every sample were at rest: those that do not fit are left out.

    Args:
        t: (T,) s.
        rotations: (T, 3, 3) sensor frame in the base frame.
        gravity: (3,) m/s^2, base frame.
        wrench: (T, 6) N, Nm, as the sensor reports it.
        rezeroed_at: s, when the sensor was set to zero: the bias is constant in between.

    Returns:
        None, if there are not enough samples, or the sensor is never turned.
    """
    complete = np.flatnonzero(np.isfinite(wrench).all(1) & np.isfinite(rotations).all((1, 2)))
    rows = complete[:: max(1, len(complete) // MOST_SAMPLES)]
    if len(rows) < LEAST_SAMPLES:
        return None
    support = -np.einsum("tji,j->ti", rotations[rows], gravity)  # what carries one kilogram, sensor frame
    force, torque = wrench[rows, :3], wrench[rows, 3:]
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
    if np.median(np.diff(t)) * LOWEST_RATE >= 1:  # static poses, from one to the next of which the bias may drift
        seconds = max(1.0, kept.sum() * (1 - max(along, 0)) / (1 + max(along, 0)))
    stderr = residual / np.sqrt(turned / len(swing) * seconds)
    arms, torques = (_about_means(x[kept], piece[kept]) for x in (support, torque))
    moment, moment_stderr = _first_moment(arms, torques, seconds)
    center = moment / mass
    center_stderr = np.minimum(np.hypot(moment_stderr, center * stderr) / abs(mass), MOST_OPEN)
    turn = 2 * np.arcsin(min(1.0, np.ptp(support[kept], axis=0).max() / 2 / np.linalg.norm(gravity)))
    return Weighed(float(mass), center, float(stderr), center_stderr, residual, float(turn))


def _about_means(values: Array, piece: Array) -> Array:
    """(T, 3) values less their mean in each piece (T,) of the log."""
    counts = np.bincount(piece)
    means = np.stack([np.bincount(piece, column) for column in values.T], 1) / np.maximum(counts, 1)[:, None]
    return values - means[piece]


def _first_moment(support: Array, torque: Array, count: float) -> tuple[Array, Array]:
    """(3,) m c of torque = (m c) x support + constant, by least squares with a weak pull to zero; and standard errors.

    ``support`` (T, 3), what carries one kilogram, and ``torque`` (T, 3) Nm are about their means; ``count`` samples are
    independent.
    """
    columns = -skew(support).reshape(-1, 3)
    pull = 1e-6 * np.trace(columns.T @ columns) * np.eye(3)
    target = torque.ravel()
    moment = np.linalg.solve(columns.T @ columns + pull, columns.T @ target)
    variance = ((target - columns @ moment) ** 2).mean() * len(support) / count
    return moment, np.sqrt(variance * np.diag(np.linalg.inv(columns.T @ columns + pull)))


def tool_keys(found: Weighed | None, is_stated: bool) -> tuple[Keys, list[str]]:
    """Keys, and a line for the person who asked, of the tool as weighed; None = the log does not turn the sensor.

    Where somebody has stated the tool's mass, a missing weight is a matter for ``check``.
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
    if found.mass < 0:
        keys["sensor.reports"] = Known("wrench_on_sensor", "because the weight has the opposite sign")
    return keys, [f"weighed by the log: {words}"]


def quietest_noise(t: Array, wrench: Array, rotations: Array) -> tuple[list[float], str] | None:
    """(6,) N, Nm: standard deviation of one sample where the log is quietest, to two digits; and where that is.

    From every stretch a cubic in time is subtracted, so that bias, drift and slow motion do not count, but noise that
    a filter in the sensor has made smooth does. Stretches in which the sensor does not turn come first; where there are
    none, what counts as noise must be as large in the halves of the stretches: otherwise it is motion.

    Args:
        t: (T,) s.
        wrench: (T, 6) N, Nm; NaN = not measured.
        rotations: (T, 3, 3) of the sensor in the base frame; NaN = not known.

    Returns:
        None if there are too few samples, an axis never changes, or the log shows motion and not noise.
    """
    rows = np.isfinite(wrench).all(1)
    t, wrench, rotations = t[rows], wrench[rows], rotations[rows]
    if len(t) < FEWEST:
        return None
    parts = list(_stretches(t))
    resting = [part for part in parts if _turned(rotations[part]) < AT_REST]
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
    return [float(f"{std:.2g}") for std in quiet], where


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
    return (left**2).sum(0)
