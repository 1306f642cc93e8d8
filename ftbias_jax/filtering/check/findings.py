"""Findings with their numbers: what is told of a mistake that is not another reading of the same model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ftbias_jax.filtering.check import special
from ftbias_jax.filtering.check.judge import Evidence, Tried
from ftbias_jax.filtering.check.mounts import LEAST_TURN
from ftbias_jax.filtering.check.result import Check, Mistake
from ftbias_jax.filtering.check.state import Alternative, Result
from ftbias_jax.io.log import Log
from ftbias_jax.io.tables.poses import Poses
from ftbias_jax.setup.rotations import rotation_from_rpy
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

STATE_TIMES = "state the times in sensor.rezeroed_at; a check of this log alone tells them to the sample"
WINDOW, FEWEST = 0.3, 8
"""s, and samples of the wrench, to either side of a tare as bins show it, within which the reading steps."""


def stamped(check: Check, setup: Setup, logs: Sequence[Log | Poses]) -> Check:
    """The findings with the times of tares to the sample, as stamps of the log, and the key that states them.

    Args:
        check: of one log, or of several, whose times differ: then it stays as it is. So do static poses.
        setup: of the log.
        logs: the log.
    """
    log = logs[0]
    if len(logs) != 1 or isinstance(log, Poses):
        return check
    return replace(check, findings=tuple(_stamped(found, setup, log) for found in check.findings))


def _stamped(found: Mistake, setup: Setup, log: Log) -> Mistake:
    if found.mistake != "rezeroed" or "times" not in found.evidence:
        return found
    new = [round(moment_of_tare(log, t) + log.start, 6) for t in found.evidence["times"]]
    words = ", ".join(f"{t:.10g} s" for t in new[:5])
    every = sorted({*new, *setup.sensor.rezeroed_at})
    shown = str(every) if len(every) <= 5 else "these times"
    remedy = f"the sensor was set to zero while it recorded, at {words}: set sensor.rezeroed_at = {shown}"
    return replace(found, evidence={"times": new}, remedy=remedy, setup={"sensor.rezeroed_at": every})


def moment_of_tare(log: Log, t: float) -> float:
    """When the reading steps the most within a window around t, s: between the last sample before and the first after.

    Args:
        log: whose wrench is looked at.
        t: s, relative to the first sample.
    """
    rows = np.flatnonzero(np.isfinite(log.wrench).all(1))
    first, last = np.searchsorted(log.t[rows], [t - WINDOW, t + WINDOW])
    middle = np.searchsorted(log.t[rows], t)
    near = rows[max(0, min(first, middle - FEWEST)) : max(last, middle + FEWEST)]
    steps = np.linalg.norm(np.diff(log.wrench[near, :3], axis=0), axis=1)
    at = int(np.argmax(steps))
    return float(log.t[near[at : at + 2]].mean())


def named(first: Evidence, tied: Sequence[Tried]) -> Mistake:
    """The mistake of the first of some alternatives, with those of the others that are not the same again.

    Args:
        first: of the setup as stated.
        tied: alternatives that explain the logs equally well, the one to name first.
    """
    different: list[Alternative] = []
    for alternative, _ in tied:
        if not any(_is_same(alternative, other) for other in different):
            different.append(alternative)
    alternative, *others = different
    alike = tuple(Mistake(other.mistake, {}, other.remedy, other.setup or {}) for other in others)
    evidence = numbers(first, tied[0][1])
    return Mistake(alternative.mistake, evidence, alternative.remedy, alternative.setup or {}, alike=alike)


def _is_same(one: Alternative, other: Alternative) -> bool:
    """Whether two alternatives ask for the same, but for the axes of the centre of mass and a few degrees."""
    a, b = one.setup or {}, other.setup or {}
    if one.mistake != other.mistake or a.get("sensor.reports") != b.get("sensor.reports"):
        return False
    if one.mistake == "gravity":
        g, h = (np.array(values["robot.gravity"]) for values in (a, b))
        return bool(g @ h > np.cos(LEAST_TURN) * np.linalg.norm(g) * np.linalg.norm(h))
    if one.mistake != "sensor_axes":
        return True
    R, S = (rotation_from_rpy(np.array(values["sensor.rotation_rpy"])) for values in (a, b))
    return bool(np.trace(R.T @ S) > 1 + 2 * np.cos(LEAST_TURN))


def absence(base: Evidence) -> Iterator[Mistake]:
    """The tool's weight is not in the reading."""
    absent = special.compensated(base)
    if absent is not None:
        mistake, remedy, setup = absent
        share = special.share_of_tool(base, 0).value
        rms = {"rms_as_stated": _rms(base.result.square[0]), "rms_if_mended": _rms(base.raw[0])}
        yield Mistake(mistake, {**rms, "share_of_the_weight": float(f"{share:.3g}")}, remedy, setup)


def clocks(base: Evidence, first: Evidence, delay: float, result: Result) -> Mistake:
    """The clocks of wrench and motion differ."""
    later, than = ("wrench", "motion") if delay > 0 else ("motion", "wrench")
    remedy = f"the {later} is stamped {abs(delay):.2f} s later than the {than}: shift its stamps"
    states = -1 <= delay <= 2 and base.state.case.setup.pose is None
    setup = {"effects.time_delay.delay": round(delay, 3)} if states else {}
    return Mistake("time_offset", {**numbers(first, result), "offset_s": round(delay, 3)}, remedy, setup)


def of_bias(base: Evidence) -> Iterator[Mistake]:
    """The bias is not what its prior says, or was set to zero on the way."""
    times = special.tares(base)
    if times and not base.state.case.moves:
        poses = [round(number) + 1 for number in times]
        words = f"the sensor was set to zero just before pose {', '.join(map(str, poses[:5]))}"
        yield Mistake("rezeroed", {"poses": poses}, f"{words}: give the poses before and after it by themselves")
        return
    if times:
        words = ", ".join(f"{t:.1f} s" for t in times[:5])
        remedy = f"the sensor was set to zero while it recorded, at {words}: {STATE_TIMES}"
        yield Mistake("rezeroed", {"times": times}, remedy)
        return
    beyond = special.bias_beyond_prior(base)
    if beyond is not None:
        mistake, remedy, setup = beyond
        offset = np.abs(np.median(base.state.wrench, 0)).max()
        yield Mistake(mistake, {"largest_reading": float(f"{offset:.5g}")}, remedy, setup, mistake == "rezeroed")


def numbers(first: Evidence, result: Result) -> dict[str, Any]:
    """Rms of what is left as stated and if mended, and of the reading itself, force and torque."""
    numbers = {"rms_raw": first.raw, "rms_as_stated": first.exact}
    if result is not first.result:
        numbers["rms_if_mended"] = result.square
    named = {name: _rms(square[0]) for name, square in numbers.items()}
    return named | {f"torque_{name}": _rms(square[1]) for name, square in numbers.items()}


def _rms(square: Array) -> float:
    return float(f"{np.sqrt(square):.4g}")
