"""Human-readable description of the noise that a log shows."""

from typing import NamedTuple

import numpy as np

from ftbias_jax.filtering.noise.blocks import Layout
from ftbias_jax.filtering.noise.contact import Contact, listed
from ftbias_jax.filtering.noise.fit_noise import Noise
from ftbias_jax.filtering.noise.slow_noise import SlowNoise
from ftbias_jax.filtering.noise.vibration import Vibration
from ftbias_jax.io.log import Repair, Repairs
from ftbias_jax.types import AXES, Array

MARGIN = 0.05
"""s before and after a contact that are left out with it."""
TOUCHED = "no free motion: something touches the tool from the first to the last second, and the bias may be off"
EITHER = "something touches the tool for much of the log, it is not certain when it is free, and the bias may be off"
TARE = "do not trust it; tare with nothing at the tool, or record some seconds of free motion"
BEGUN_AGAIN = (
    "the gate rejected most readings after the first ones: the bias was initialised at the log's median instead"
)


class LogNoise(NamedTuple):
    """Contact and noise that a log shows beyond its setup."""

    contacts: tuple[Contact, ...]
    vibration: Vibration | None
    """None = the log is too short to estimate it."""
    slow: SlowNoise | None
    """None = as the setup states."""
    offset: Array
    """(6,) N, Nm: bias at the start minus the prior's mean on axes where the prior does not expect it, 0 elsewhere."""
    inflation: Array
    """(6,) factor, 1 or more, on the standard deviations of bias and drift that the innovations still contradict."""
    begun_again: bool = False
    """Whether the bias begins at the log's median, because the gate rejected most samples after the first readings."""
    hidden: Array = np.zeros(6)
    """(6,) N, Nm: possible error of the bias because the tool is touched throughout, or may be while it seems free;
    0 = the log has free motion."""
    undecided: bool = False
    """Whether contact and free motion alternate, and may be confused."""
    density: Array = np.zeros(6)
    """(6,) N/s^1.5, Nm/s^1.5: density of a bias that wanders more than stated, 0 on axes where it does not."""
    tool_error: float = 0.0
    """Relative error of the tool's force as stated, which the standard deviations of the bias include; 0 = none."""
    kept_out: float = 0.0
    """Share of the free samples that the gate rejects wherever the bias begins; 0 = it passes at least half."""


def nothing() -> LogNoise:
    """Noise of a log that agrees with its setup."""
    return LogNoise((), None, None, np.zeros(6), np.ones(6))


def log_noise_from(found: Noise, layout: Layout, *, slow_is_stated: bool) -> LogNoise:
    """The noise found in a log, as NumPy arrays; slow errors that the setup states do not count as found."""
    contacts, slow = listed(found.contacts, found.block_times, layout), None if slow_is_stated else found.slow
    speed = np.inf if found.vibration.speed is None else float(found.vibration.speed)
    vibration = found.vibration._replace(speed=speed if np.isfinite(speed) else None)
    hidden, density = np.asarray(found.hidden), np.asarray(found.density)
    return LogNoise(
        contacts,
        vibration,
        slow,
        found.offset,
        found.inflation,
        hidden=hidden,
        density=density,
        undecided=bool((np.asarray(found.contacts.undecided) == hidden).all() and hidden.any()),
        tool_error=float(found.tool_error),
    )


def describe(noise: LogNoise) -> list[str]:
    """Lines for a reader on what the log shows beyond its setup; none if nothing."""
    lines = []
    if noise.offset.any():
        words = by_axis(noise.offset, noise.offset != 0, 4)
        lines.append(f"the bias at the start is far from what the setup expects, by N, Nm: {words}")
    if noise.begun_again:
        lines.append(BEGUN_AGAIN)
    for contact in noise.contacts:
        size = np.linalg.norm(contact.force[:3])
        lines.append(f"contact from {contact.start:.2f} to {contact.end:.2f} s, up to {size:.2g} N: not used")
    if noise.vibration is not None and noise.vibration.taken and noise.vibration.per_speed.any():
        lines.append("the noise grows with the speed of the motion; the filter takes what the scatter of the log shows")
    if noise.vibration is not None and (noise.vibration.level != 1).any():
        words = by_axis(np.sqrt(noise.vibration.level), noise.vibration.level != 1)
        kept = "; where it is less, the filter keeps the stated one" if (noise.vibration.level < 1).any() else ""
        lines.append(f"scatter of single readings at rest, per stated noise_std: {words}{kept}")
    if noise.slow is not None and noise.slow.std.any():
        of_axes = zip(AXES, noise.slow.std, noise.slow.time, strict=True)
        words = ", ".join(f"{name} {std:.2g} over {time:.2g} s" for name, std, time in of_axes if std > 0)
        lines.append(f"errors that vary slowly (N, Nm and correlation time): {words}")
    if noise.density.any():
        words = by_axis(noise.density, noise.density > 0)
        lines.append(f"the bias wanders more than stated, noise_density in N/s^1.5, Nm/s^1.5: {words}")
    if (noise.inflation > 1).any():
        words = by_axis(noise.inflation, noise.inflation > 1)
        lines.append(f"standard deviations of the bias are enlarged, by what the innovations still contradict: {words}")
    return lines


def by_axis(values: Array, shown: Array | None = None, digits: int = 2) -> str:
    """Names and values (6,) of the axes that are shown, None = all."""
    noticed = np.ones(6, bool) if shown is None else shown
    return " ".join(
        f"{name} {x:.{digits}g}" for name, x, is_shown in zip(AXES, values, noticed, strict=True) if is_shown
    )


def force_of_tool(error: float, whose: str) -> str:
    """How large the tool's force is in the reading, relative to that of the setup's or the calibrated tool."""
    return f"the force that follows the tool is {1 + error:.3g} times what {whose} tool causes"


def remarks_of_noise(noise: LogNoise) -> Repairs:
    """Remarks for the owner: no free motion, or a gate that rejected most of the log; () as a rule."""
    repairs = [Repair(BEGUN_AGAIN)] if noise.begun_again else []
    if noise.tool_error:
        what = force_of_tool(noise.tool_error, "the setup's")
        why = "another tool, a gain, or long contact?"
        repairs.append(Repair(f"{what}: {why} Run ftbias identify or diagnose; the error bars include it"))
    if noise.hidden.any():
        why = EITHER if noise.undecided else TOUCHED
        return (*repairs, Repair(f"{why}, by {by_axis(noise.hidden)} N, Nm: {TARE}", lost=True))
    if not noise.kept_out:
        return tuple(repairs)
    what = f"the gate keeps out {noise.kept_out:.0%} of the log, for any initial bias: do not trust the bias"
    return (*repairs, Repair(f"{what}, and look for the cause by ftbias diagnose", lost=True))
