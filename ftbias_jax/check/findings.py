"""Findings: alternatives that are named, and what is none: an absent weight, an offset, clocks that differ."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ftbias_jax.check.contact import ZERO, zeroed_on_the_way
from ftbias_jax.check.judge import ABSENT, BAD, GOOD, Evidence, Tried, decisively, score
from ftbias_jax.check.mounts import LEAST_TURN
from ftbias_jax.check.regression import squares, without_bias
from ftbias_jax.check.result import Mistake
from ftbias_jax.check.state import Alternative, Result, State, delayed
from ftbias_jax.setup.rotations import rotation_from_rpy
from ftbias_jax.types import Array

WORSE = 1.15
"""Factor of the raw variance from which a model is worse than nothing."""
LEAST_OFFSET = 0.2
OFFSETS = np.concatenate([np.arange(-5, -LEAST_OFFSET + 0.01, 0.05), np.arange(LEAST_OFFSET, 5.01, 0.05)])
"""s, delays of the wrench that are tried; shorter ones are effects (time_delay, low_pass), not mistakes."""
NEAR_OFFSET = 0.16
"""s around the best one for the stated tool within which the tool is fitted again."""
OFFSET_BAD, OFFSET_BETTER = 0.01, 0.4
"""Share of the raw variance that must be left without the offset, and share of that which it may leave."""
LAGS, NEAR_LAGS = (0.1, 0.2, 0.3, 0.5, 0.8), np.linspace(0.75, 1.1, 8)
"""s by which a low pass of the first order delays, which can look like an offset; of the second, per offset."""
FAR = 8.0
"""Standard deviations of the prior beyond which the bias is not what the setup expects."""
FIRST = 2.0
"""s at the start that show the bias which the prior speaks of."""
BY_CHANCE = 1e-6
"""Probability from which a first reading of zero on every axis is no accident of the bias."""


def worse_than_raw(base: Evidence) -> bool:
    """Whether the tool exactly as stated leaves more of force or torque than no tool would."""
    absent = [share.clear and share.value + 3 * share.stderr < 0.5 for share in base.shares]
    return bool((absent & (base.exact > WORSE * base.raw)).any())


def as_stated(base: Evidence) -> Mistake:
    """That the tool as stated is worse than none: another tool explains it, or nothing that is known here."""
    remedy = "check tool, signs, units and frames of the setup: what is wrong is not on the list of this check"
    mended_by: tuple[str, ...] = ("identify",)
    if base.free is not None and (base.free.square < BAD * base.raw).all():
        remedy, mended_by = "another tool explains the reading: ftbias identify", ("identify", "diagnose", "calibrate")
    return Mistake("worse_than_raw", numbers(base, base.result), remedy, mended_by=mended_by)


def absence(base: Evidence) -> Iterator[Mistake]:
    """The tool's weight is not in the reading; nothing if it is, or if nothing shows it."""
    share = base.shares[0]
    if not share.clear or abs(share.value) + 2 * share.stderr > ABSENT or base.left[0] < 1:
        return
    state = base.state
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
    """How much later than the motion the wrench is stamped, s, and the fit with it; None if that is not the mistake."""
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
        return None  # a shorter one may do better
    if not result.square[0] < OFFSET_BETTER * base.result.square[0] or result.square[0] > GOOD * base.raw[0]:
        return None
    for lag, order in (*((lag, 1) for lag in LAGS), *((abs(best) * share, 2) for share in NEAR_LAGS)):
        # The closer to an offset, the better must a low pass be to stand for it.
        if state.but(lag=lag, order=order).fit().square[0] < 2 / order * result.square[0]:
            return None
    return (float(best), result) if decisively(base.result, result, (0,), layout.block) else None


def of_bias(base: Evidence) -> Iterator[Mistake]:
    """The bias was set to zero on the way, or is not what its prior says: a raw offset, or zero with the tool on."""
    tared = zeroed_on_the_way(base)
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
    # What touches the sensor as the log begins moves its reading, but not the level of the log.
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
    """Whether a first reading of zero is what the setup's prior excludes: the tool's weight is expected beside it."""
    setup, axes = state.case.setup, state.case.layout.axes
    tool, std = state.of_tool, setup.bias.initial_std
    near, moved = _near_zero(state, tool), np.abs(tool[1] - tool[0])
    by_chance = np.prod(np.minimum(1, near / std)[axes])
    weight = np.abs(tool[0] - setup.bias.initial)[axes]  # expected to be read, beside zero
    return bool((weight > (std + moved)[axes]).any() or ((weight > near[axes]).any() and by_chance < BY_CHANCE))


def _near_zero(state: State, tool: Array) -> Array:
    """(6,) N, Nm: how far from zero a first reading may be: a tool that moves moves on within the first bin."""
    return ZERO * state.case.setup.sensor.noise_std + state.case.moves * np.abs(tool[1] - tool[0])


def named(first: Evidence, tied: Sequence[Tried]) -> Mistake:
    """The mistake of the first of alternatives that do as well, beside it those of the others that differ from it."""
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


def clocks(base: Evidence, first: Evidence, delay: float, result: Result) -> Mistake:
    """The clocks of wrench and motion differ."""
    later, than = ("wrench", "motion") if delay > 0 else ("motion", "wrench")
    remedy = f"the {later} is stamped {abs(delay):.2f} s later than the {than}: shift its stamps"
    states = -1 <= delay <= 2 and base.state.case.setup.pose is None
    setup = {"effects.time_delay.delay": round(delay, 3)} if states else {}
    return Mistake("time_offset", {**numbers(first, result), "offset_s": round(delay, 3)}, remedy, setup)


def numbers(first: Evidence, result: Result) -> dict[str, Any]:
    """Rms of what is left as stated and if mended, and of the reading itself, force and torque."""
    numbers = {"rms_raw": first.raw, "rms_as_stated": first.exact}
    if result is not first.result:
        numbers["rms_if_mended"] = result.square
    named = {name: _rms(square[0]) for name, square in numbers.items()}
    return named | {f"torque_{name}": _rms(square[1]) for name, square in numbers.items()}


def _rms(square: Array) -> float:
    return float(f"{np.sqrt(square):.4g}")
