"""Distinguish contact from mistakes: by the contact-free part of a log, and by the levels before and after a step."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ftbias_jax.check.judge import BETTER, Evidence, noise_of_bins
from ftbias_jax.check.regression import squares, without_bias
from ftbias_jax.check.result import Check, Mistake
from ftbias_jax.check.state import Alternative, Result, State
from ftbias_jax.io.log import Log
from ftbias_jax.io.tables.poses import Poses
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

EXPLAINED, LEAST_PART, WORSE_THERE = 0.1, 0.1, 4.0
"""Maximum residual of a correct setup in a contact-free part of a log, as a share of the tool's variance there; minimum
of that variance relative to the whole log; and factor of the residual up to which no alternative is rejected."""
UNTOUCHED = 0.75
"""Share of the log that may be contact."""
CLEAR = 3.0
"""Minimum standard deviation of the tool's force in that part, in units of the noise of a bin."""
ZERO = 6.0
"""Standard deviations of a sample within which a reading counts as zero."""
STEEP = 2.5
"""Minimum height of a step relative to the change within the bins before or after it; a ramp has a ratio of two."""
BESIDE, MOMENTS = 3, 9
"""Bins before and after a tare from which the bias is taken, and candidate times of the tare within a bin."""
NEAR, FAR_OFF = 0.25, 0.5
"""Tolerance, as a share of a step, within which a bin is at a level: along the step and across it."""
RUN = 5
"""Consecutive bins at a level that establish it."""
STILL = 0.02
"""rad/s, m/s; slower joints stand still."""
AROUND = 20
"""Bins on either side of a step over which the levels around it must hold."""
STATE_TIMES = "state the times in sensor.rezeroed_at; check this log on its own to get the times to the sample"
WINDOW, FEWEST = 0.3, 8
"""s, and wrench samples, on either side of a tare found in bins, within which the step of the reading is sought."""


def stamped(check: Check, setup: Setup, log: Log | Poses) -> Check:
    """Refine the tares in the findings to single samples, as stamps of the log, and add the key that states them.

    A check of static poses is returned unchanged.
    """
    if isinstance(log, Poses):
        return check
    return replace(check, findings=tuple(_stamped(found, setup, log) for found in check.findings))


def _stamped(found: Mistake, setup: Setup, log: Log) -> Mistake:
    if found.mistake != "rezeroed" or "times" not in found.evidence:
        return found
    new = [round(tare_time(log, t) + log.start, 6) for t in found.evidence["times"]]
    words = ", ".join(f"{t:.10g} s" for t in new[:5])
    every = sorted({*new, *setup.sensor.rezeroed_at})
    shown = str(every) if len(every) <= 5 else "these times"
    remedy = f"the sensor was set to zero while it recorded, at {words}: set sensor.rezeroed_at = {shown}"
    return replace(found, evidence={"times": new}, remedy=remedy, setup={"sensor.rezeroed_at": every})


def tare_time(log: Log, t: float) -> float:
    """Return the time, s, of the reading's largest step around t, s: midway between the two samples of the step."""
    rows = np.flatnonzero(np.isfinite(log.wrench).all(1))
    first, last = np.searchsorted(log.t[rows], [t - WINDOW, t + WINDOW])
    middle = np.searchsorted(log.t[rows], t)
    near = rows[max(0, min(first, middle - FEWEST)) : max(last, middle + FEWEST)]
    steps = np.linalg.norm(np.diff(log.wrench[near, :3], axis=0), axis=1)
    at = int(np.argmax(steps))
    return float(log.t[near[at : at + 2]].mean())


class Untouched(NamedTuple):
    """The part of a log where the stated setup is shown to be right."""

    rows: Array
    """(N,) mask of the bins in that part."""
    size: Array
    """(2,) variance of the stated tool's force and torque there, N^2 and Nm^2."""
    left: Array
    """(2,) residual variance of force and torque there with the stated setup, N^2 and Nm^2."""


def untouched(base: Evidence) -> Untouched | None:
    """Return the part of the log that the stated setup explains best, if that part shows the setup to be right.

    A mistake affects a whole log, a contact only part of it: if the stated tool turns and the reading follows it for a
    quarter of the log, then signs, frames and force are right, whatever happens in the rest. None: no part shows it.
    """
    state = base.state
    if state.swapped:
        return None
    case = state.case.trimmed(UNTOUCHED)
    steady = (case.log[:, None] == np.unique(case.log)).astype(float)  # the part may be too short to constrain a drift
    part = state.but(case=replace(case, layout=case.layout._replace(basis=steady))).fit()
    rows, tool = part.fit.kept, state.of_tool * np.repeat(state.unit, 3)

    def size(bins: Array) -> Array:
        return squares(without_bias(tool[bins], case.layout._replace(basis=steady[bins]))).mean(0)

    found = Untouched(rows, size(rows), part.square)
    least = max((CLEAR * noise_of_bins(state)[0]) ** 2, LEAST_PART * size(np.ones(len(rows), bool))[0])
    return found if found.size[0] > least and found.left[0] < EXPLAINED * found.size[0] else None


def mimicked_by_contact(part: Untouched | None, alternative: Alternative, result: Result) -> bool:
    """Return whether contact mimics an alternative: it fails where the stated setup is shown to be right."""
    if part is None:
        return False
    left = result.errors[part.rows].mean(0)
    if alternative.scale:  # wrong units would affect that part, too
        fails = (part.left < EXPLAINED * part.size) & (left > BETTER * part.left)
    else:
        fails = (left > EXPLAINED * part.size) & (left > WORSE_THERE * part.left)
    return bool(fails[list(alternative.groups)].any())


def tared_while_recording(base: Evidence) -> Mistake | None:
    """Return the mistake that the sensor was set to zero during the recording; None if it was not."""
    times = tares(base)
    if not times:
        return None
    if not base.state.case.moves:
        poses = [round(number) + 1 for number in times]
        words = f"the sensor was set to zero just before pose {', '.join(map(str, poses[:5]))}"
        return Mistake("rezeroed", {"poses": poses}, f"{words}: give the poses before and after it by themselves")
    words = ", ".join(f"{t:.1f} s" for t in times[:5])
    remedy = f"the sensor was set to zero while it recorded, at {words}: {STATE_TIMES}"
    return Mistake("rezeroed", {"times": times}, remedy)


def tares(base: Evidence) -> list[float]:
    """Times, s, at which the sensor was set to zero during the recording: the reading jumps to zero on every axis.

    The reading also jumps to zero where a contact ends in a pose in which the sensor had been set to zero before.
    """
    state = base.state
    case = state.case
    noise = case.setup.sensor.noise_std
    if (state.unit != 1).any() or not case.layout.axes.all():
        return []
    t, reading, tool = case.bins.t, state.wrench, state.of_tool
    if len(t) <= 2 * BESIDE:
        return []
    # For every bin with enough neighbours: the bins on either side (N, 6, BESIDE), and whether its log pauses there.
    beside = np.lib.stride_tricks.sliding_window_view(reading - tool, BESIDE, axis=0)
    before, after = beside[: -BESIDE - 1], beside[BESIDE + 1 :]
    scatter = np.maximum(ZERO * noise, np.maximum(np.ptp(before, axis=2), np.ptp(after, axis=2)))
    level, former = np.median(after, 2), np.median(before, 2)
    jumps = (np.abs(level - former) > STEEP * scatter)[:, :3].any(1)
    pause = float(np.median(np.diff(t)))
    first, last = slice(None, -2 * BESIDE), slice(2 * BESIDE, None)
    together = (case.log[first] == case.log[last]) & (t[last] - t[first] <= 3 * BESIDE * pause + 1)
    found: list[int] = []
    for k in map(int, np.flatnonzero(jumps & together)):
        i = k + BESIDE
        if found and i - found[-1] < max(BESIDE, 1 / pause):
            continue
        # At some time between the previous and the next bin the reading must have been zero on every axis.
        zeroed = level[k] + np.concatenate([np.linspace(tool[j], tool[j + 1], MOMENTS) for j in (i - 1, i)])
        if not (np.abs(zeroed) < scatter[k]).all(1).any() or (np.abs(reading[k:i]) < scatter[k]).all():
            continue
        if not _returns(state, i, former[k], level[k]) and (
            # A contact begins or ends by motion.
            np.abs(case.bins.dq[i - 1 : i + 2]).max() < STILL or _is_free(state, i, former[k], level[k])
        ):
            change = np.linalg.norm(np.diff((reading - tool)[i - 1 : i + 2, :3], axis=0), axis=1)
            found.append(i + int(np.argmax(change)))
    return [float(t[i]) for i in found]


def _returns(state: State, i: int, former: Array, level: Array) -> bool:
    """Return whether the new level occurred before bin i or the former recurs after it: a contact ended or began."""
    case = state.case
    scale = case.setup.sensor.noise_std
    rows = np.flatnonzero(case.log == case.log[i])
    off = (state.wrench - state.of_tool - former)[rows] / scale
    step = (level - former) / scale
    size = np.linalg.norm(step)
    along = off @ step / size**2
    near = np.linalg.norm(off - along[:, None] * step, axis=1) < FAR_OFF * size
    seen = near & (np.abs(along - 1) < NEAR) & (rows < i - BESIDE)
    again = near & (np.abs(along) < NEAR) & (rows > i + BESIDE)
    return any(bool((np.convolve(at, np.ones(RUN), "valid") == RUN).any()) for at in (seen, again) if len(at) >= RUN)


def _is_free(state: State, i: int, former: Array, level: Array) -> bool:
    """Return whether the levels around bin i hold while the arm moves, unlike those of a tool resting on a table."""
    case = state.case
    left = (state.wrench - state.of_tool)[:, :3]
    most = NEAR * np.linalg.norm((level - former)[:3])
    for rows in (slice(max(0, i - AROUND), i - 1), slice(i + 2, i + 2 + AROUND)):
        near = left[rows][case.log[rows] == case.log[i]]
        moves = np.median(np.abs(case.bins.dq[rows]).max(1)) > STILL
        if not moves or np.linalg.norm(np.median(np.abs(near - np.median(near, 0)), 0)) > most:
            return False
    return True
