"""Findings of a check: reported alternatives, and mistakes other than these: an absent weight, an offset, clocks."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ftbias_jax.check.contact import ZERO, tared_while_recording
from ftbias_jax.check.judge import ABSENT, BAD, GOOD, Evidence, Tried, decisively, score
from ftbias_jax.check.mounts import LEAST_TURN
from ftbias_jax.check.regression import squares, without_bias
from ftbias_jax.check.result import Mistake
from ftbias_jax.check.state import Alternative, Result, State, delayed
from ftbias_jax.setup.rotations import rotation_from_rpy
from ftbias_jax.types import Array

PRESENT = 0.5
"""Rms of a force, as a share of the tool's weight, above which the weight may be in it."""
WORSE = 1.15
"""Ratio of the residual to the raw variance above which a model is worse than none."""
LEAST_OFFSET = 0.2
OFFSETS = np.concatenate([np.arange(-5, -LEAST_OFFSET + 0.01, 0.05), np.arange(LEAST_OFFSET, 5.01, 0.05)])
"""s, delays of the wrench that are tried; shorter ones are effects (time_delay, low_pass), not mistakes."""
NEAR_OFFSET = 0.16
"""s from the best delay for the stated tool, within which the tool is fitted again."""
OFFSET_BAD, OFFSET_BETTER = 0.01, 0.4
"""Minimum residual without the offset, as a share of the raw variance; maximum share of that left with it."""
LAGS, NEAR_LAGS = (0.1, 0.2, 0.3, 0.5, 0.8), np.linspace(0.75, 1.1, 8)
"""Low-pass delays that can look like an offset: of first order in s, of second order relative to the offset."""
FAR = 8.0
"""Standard deviations of the prior beyond which the bias contradicts the setup."""
FIRST = 2.0
"""s at the start of the log from which the initial bias is estimated, which the prior describes."""
BY_CHANCE = 1e-6
"""Probability below which a first reading of zero on every axis is not attributed to chance."""


def worse_than_raw(base: Evidence) -> bool:
    """Return whether the tool exactly as stated leaves a larger force or torque residual than no tool."""
    absent = [share.clear and share.value + 3 * share.stderr < 0.5 for share in base.shares]
    return bool((absent & (base.exact > WORSE * base.raw)).any())


def as_stated(base: Evidence) -> Mistake:
    """Return the mistake that the stated tool is worse than none, whether another tool explains the reading or not."""
    remedy = (
        "check tool, signs, units and frames of the setup: the mistake is none of those that this check can identify, "
        "unless a hose or a balancer pulls harder than the tool weighs"
    )
    mended_by: tuple[str, ...] = ("identify",)
    if base.free is not None and (base.free.square < BAD * base.raw).all():
        remedy, mended_by = "another tool explains the reading: ftbias identify", ("identify", "diagnose", "calibrate")
    return Mistake("worse_than_raw", numbers(base, base.result), remedy, mended_by=mended_by)


def absence(base: Evidence) -> Iterator[Mistake]:
    """Yield the mistake that the tool's weight is not in the reading; nothing if it is, or if no log shows it."""
    share = base.shares[0]
    if not share.clear or abs(share.value) + 2 * share.stderr > ABSENT or base.left[0] < 1:
        return
    state = base.state
    weight = state.tool.theta[0] * np.linalg.norm(state.gravity)
    if not state.case.layout.touched and base.raw[0] > (PRESENT * weight) ** 2:
        return  # what varies as much as a weight that turns is one, seen from the wrong pose
    weightless = state.but(gravity=np.zeros(3))
    if state.specific_force is not None:  # an accelerometer has gravity in it
        weightless = state.but(specific_force=None)
    moving = score(base, weightless.fit()) > score(base, base.without_tool) + 0.1
    what = "weight" if moving else "tool"
    words = "the tool's weight is" if moving else "the tool's weight and inertia are"
    remedy = f'{words} not in the reading (the controller subtracts the payload): set sensor.compensated = "{what}"'
    rms = {"rms_as_stated": _rms(base.result.square[0]), "rms_if_mended": _rms(base.raw[0])}
    evidence = {**rms, "share_of_the_weight": float(f"{share.value:.3g}")}
    yield Mistake("compensated", evidence, remedy, {"sensor.compensated": what})


def time_offset(base: Evidence) -> tuple[float, Result] | None:
    """Return the delay, s, of the wrench's stamps behind the motion's, and the fit with it; None if there is none."""
    left = base.left[0]
    if left < OFFSET_BAD:
        return None
    state = base.state
    tool = state.data @ base.result.fit.theta
    layout = state.case.layout
    reading = without_bias(state.wrench, layout)
    scale = np.repeat(np.sqrt(np.median(squares(reading), 0)) + 1e-9, 3)

    def misfit(offset: float) -> float:
        moved = without_bias(delayed(state.case, tool, offset), layout)
        return float(np.median((((reading - moved) / scale) ** 2).sum(1)))

    best = min(OFFSETS, key=misfit)
    near = OFFSETS[np.abs(OFFSETS - best) < NEAR_OFFSET]  # with the tool fitted again
    result, best = min(((state.but(delay=float(x)).fit(), x) for x in near), key=lambda pair: pair[0].square[0])
    if abs(best) < LEAST_OFFSET + 0.01:
        return None  # a delay below LEAST_OFFSET may fit better
    if not result.square[0] < OFFSET_BETTER * base.result.square[0] or result.square[0] > GOOD * base.raw[0]:
        return None
    for lag, order in (*((lag, 1) for lag in LAGS), *((abs(best) * share, 2) for share in NEAR_LAGS)):
        # A second-order low pass resembles an offset more closely, so it must fit better to replace it.
        if state.but(lag=lag, order=order).fit().square[0] < 2 / order * result.square[0]:
            return None
    return (float(best), result) if decisively(base.result, result, (0,), layout.block) else None


def of_bias(base: Evidence) -> Iterator[Mistake]:
    """Yield mistakes of the bias: zeroed while recording or with the tool on, or an offset far outside its prior."""
    tared = tared_while_recording(base)
    if tared is not None:
        yield tared
        return
    state = base.state
    setup, bins = state.case.setup, state.case.bins
    if setup.sensor.rezeroed or (state.unit != 1).any():
        return
    tool = state.of_tool
    axes, std = state.case.layout.axes, setup.bias.initial_std
    near = _near_zero(state, tool)
    largest = {"largest_reading": float(f"{np.abs(np.median(state.wrench, 0)).max():.5g}")}
    # Contact at the start of the log changes the first readings, but not the level of the whole log.
    level = np.median((tool - state.wrench)[base.result.fit.kept], 0)
    zero = (np.abs(state.case.wrench[0]) < near)[axes].all()
    stays = np.linalg.norm((level - tool[0])[:3]) < np.linalg.norm((tool[0] - setup.bias.initial)[:3]) / 2
    if zero and stays and zero_would_show(state):
        remedy = "the sensor was set to zero with the tool on: set sensor.rezeroed = true"
        yield Mistake("rezeroed", largest, remedy, {"sensor.rezeroed": True}, harmless=True)
        return
    bias = np.median((tool - state.wrench)[bins.t - bins.t[0] < FIRST], 0)
    off = np.minimum(*(np.abs(x - setup.bias.initial) for x in (bias, level))) - 2 * np.abs(tool).max(0)
    if (off[axes] > FAR * std[axes]).any():
        stated = [float(f"{x:.6g}") for x in bias]
        remedy = f"the reading is offset by {np.abs(bias).max():.4g}: set bias.initial = {stated}"
        yield Mistake("raw_offset", largest, remedy, {"bias.initial": stated})


def zero_would_show(state: State) -> bool:
    """Return whether the setup's prior excludes a first reading of zero: the tool's weight is expected in it."""
    setup, axes = state.case.setup, state.case.layout.axes
    tool, std = state.of_tool, setup.bias.initial_std
    near, moved = _near_zero(state, tool), np.abs(tool[1] - tool[0])
    by_chance = np.prod(np.minimum(1, near / std)[axes])
    weight = np.abs(tool[0] - setup.bias.initial)[axes]  # expected distance of the first reading from zero
    return bool((weight > (std + moved)[axes]).any() or ((weight > near[axes]).any() and by_chance < BY_CHANCE))


def _near_zero(state: State, tool: Array) -> Array:
    """(6,) N, Nm: tolerance for a first reading of zero; a moving tool changes its wrench within the first bin."""
    return ZERO * state.case.setup.sensor.noise_std + state.case.moves * np.abs(tool[1] - tool[0])


def named(first: Evidence, tied: Sequence[Tried]) -> Mistake:
    """Return the first of equally good alternatives as the mistake, and the others that differ from it as ``alike``."""
    different: list[Alternative] = []
    for alternative, _ in tied:
        if not any(_is_same(alternative, other) for other in different):
            different.append(alternative)
    alternative, *others = different
    alike = tuple(Mistake(other.mistake, {}, other.remedy, other.setup or {}) for other in others)
    evidence = numbers(first, tied[0][1])
    return Mistake(alternative.mistake, evidence, alternative.remedy, alternative.setup or {}, alike=alike)


def _is_same(one: Alternative, other: Alternative) -> bool:
    """Return whether two alternatives demand the same, up to the centre of mass's axes and rotations by LEAST_TURN."""
    a, b = one.setup or {}, other.setup or {}
    if one.mistake != other.mistake or a.get("sensor.reports") != b.get("sensor.reports"):
        return False
    if a.keys() & b.keys() & {"robot.gravity"}:
        g, h = (np.array(values["robot.gravity"]) for values in (a, b))
        if g @ h < np.cos(LEAST_TURN) * np.linalg.norm(g) * np.linalg.norm(h):
            return False
    if one.mistake != "sensor_axes":
        return True
    if ("robot.gravity" in a) != ("robot.gravity" in b):
        return False
    R, S = (rotation_from_rpy(np.array(values["sensor.rotation_rpy"])) for values in (a, b))
    return bool(np.trace(R.T @ S) > 1 + 2 * np.cos(LEAST_TURN))


def clocks(base: Evidence, first: Evidence, delay: float, result: Result) -> Mistake:
    """Return the mistake that the clocks of wrench and motion differ."""
    later, than = ("wrench", "motion") if delay > 0 else ("motion", "wrench")
    remedy = f"the {later} is stamped {abs(delay):.2f} s later than the {than}: shift its stamps"
    stated, setup = base.state.case.setup, dict[str, float]()
    if "wrench" in stated.log.files:
        setup = {"log.time_offsets.wrench": round(stated.log.time_offsets.get("wrench", 0.0) - delay, 3)}
        remedy += f" by log.time_offsets.wrench = {setup['log.time_offsets.wrench']}"
    elif -1 <= delay <= 2 and stated.pose is None:
        setup = {"effects.time_delay.delay": round(delay, 3)}
    return Mistake("time_offset", {**numbers(first, result), "offset_s": round(delay, 3)}, remedy, setup)


def numbers(first: Evidence, result: Result) -> dict[str, Any]:
    """Rms of the raw reading and of the residuals of the setup as stated and as corrected, for force and torque."""
    numbers = {"rms_raw": first.raw, "rms_as_stated": first.exact}
    if result is not first.result:
        numbers["rms_if_mended"] = result.square
    named = {name: _rms(square[0]) for name, square in numbers.items()}
    return named | {f"torque_{name}": _rms(square[1]) for name, square in numbers.items()}


def _rms(square: Array) -> float:
    return float(f"{np.sqrt(square):.4g}")
