"""Logs of a tool of unknown weight: where the sensor does not turn, the weight is part of the bias.

A constant weight and a constant bias are indistinguishable to the sensor. Contact and drift, which change, can be found
without the tool; the weight itself only from a log that turns it.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.cleaning import slices
from ftbias_jax.io.log import Log, Repair, Repairs
from ftbias_jax.io.pose import sensor_rotations
from ftbias_jax.setup.require import has_no_tool, require_tool, with_guessed_tool
from ftbias_jax.setup.types import COMPENSATED, Setup
from ftbias_jax.types import Array

LEAST_TURN = np.radians(3.0)
"""rad, rms of gravity's direction in the sensor frame; a smaller turn is indistinguishable from a drifting bias."""
PART, MOST_ROWS = 1 << 16, 2000
"""Samples of a log read at once, and maximum number of them that are examined."""
HEAVIEST = (100.0, 10.0)
"""N, Nm: possible weight of a tool of unknown mass, as prior standard deviation of the bias."""
LEAST_WEIGHT_CHANGE = 1e-6
"""N, smallest change of the weight of a kilogram that is reported."""
RESTS = 0.01
"""rad (m): joints that move less make no acceleration worth reporting."""
ACCELERATIONS = "the tool's accelerations stay in the wrench and may be taken for contact, until the tool is identified"
TURN_IT = "turn the sensor by 30 degrees or more about two horizontal axes, and touch nothing"


class RangeOfMotion(NamedTuple):
    """How far a log moves the sensor."""

    turn: float
    """rad, rms of the direction of gravity in the sensor frame."""
    most: float
    """N, largest change of the weight of one kilogram."""
    travel: float
    """rad (m), the largest range of a joint, or of an entry of the pose."""

    @property
    def rests(self) -> bool:
        """Whether neither a weight nor an acceleration changes."""
        return self.turn < LEAST_TURN and self.travel < RESTS


def weight_in_bias(setup: Setup, parts: Callable[[int], Iterator[Log]]) -> tuple[Setup, Repairs]:
    """The setup to filter a log of an unknown tool with, and remarks for its owner; stated tools stay.

    Without mass or centre of mass it predicts nothing of the tool, and its bias may be as large as a weight: the bias
    of the result is then that of the sensor minus the tool's weight. ``parts``: samples per part -> the log in parts.

    Raises:
        SetupError: the log turns the sensor, so that the tool must be known.
    """
    if not setup.tool.unknown or has_no_tool(setup):
        return setup, ()
    motion = motion_of(setup, parts)
    if motion.turn > LEAST_TURN:
        require_tool(setup)
    keys = " and ".join(f"tool.{key}" for key in setup.tool.unknown)
    what = f"{keys} not stated, but the sensor turns by only {_degrees(motion.turn)} degrees: "
    what += "the tool's weight is taken as part of the bias"
    if motion.most > LEAST_WEIGHT_CHANGE:
        what += f", and each kilogram leaves up to {motion.most:.2g} N in the corrected wrench"
    moves = f"; {ACCELERATIONS}" if motion.travel > RESTS else ""
    wide = np.hypot(setup.bias.initial_std, np.repeat(HEAVIEST, 3))
    guessed = with_guessed_tool(setup)
    changed = replace(
        guessed,
        tool=replace(guessed.tool, mass_std=None, center_of_mass_std=None),
        sensor=replace(setup.sensor, compensated=COMPENSATED[2]),
        bias=replace(setup.bias, initial_std=wide),
    )
    return changed, (Repair(what + moves),)


def rest_in_words(setup: Setup, parts: Callable[[int], Iterator[Log]]) -> str:
    """What a log that does not turn the sensor can show; "" if it turns it. Arguments as for ``weight_in_bias``."""
    motion = motion_of(setup, parts)
    if motion.rests:
        return f"at rest: only bias and noise can be estimated ({TURN_IT})"
    if motion.turn > LEAST_TURN:
        return ""
    return (
        f"the sensor turns by only {_degrees(motion.turn)} degrees: only bias and noise can be estimated, "
        f"and signs, units, frames and the tool cannot be checked ({TURN_IT})"
    )


def require_motion(setup: Setup, log: Log, file: str = "") -> None:
    """Refuse a log of an arm at rest where motion is needed.

    Raises:
        LogError: the arm stands still.
    """
    if motion_of(setup, slices(log)).rests:
        message = "is of an arm at rest: only bias and noise can be estimated, nothing of the tool"
        raise LogError(message, file=file, field="q", remedy=TURN_IT)


def motion_of(setup: Setup, parts: Callable[[int], Iterator[Log]]) -> RangeOfMotion:
    """Range of motion of the sensor in a log, from the rows that have the joints or the orientation."""
    down, low, high = [np.empty((0, 3))], [], []
    for part in parts(PART):
        q = part.q[np.isfinite(part.q[:, :4] if setup.pose else part.q).all(1)]
        if len(q):
            low.append(q.min(0))
            high.append(q.max(0))
            q = q[:: -(-len(q) // MOST_ROWS)]
            rotations = sensor_rotations(np.arange(len(q), dtype=float), q, setup)
            down.append(np.einsum("tji,j->ti", rotations, setup.robot.gravity))
    every = np.concatenate(down)
    if not len(every):  # no row has all joints: nothing is known, so nothing is promised
        return RangeOfMotion(np.inf, np.inf, np.inf)
    off = np.linalg.norm(every - every.mean(0), axis=1)
    travel: Array = np.max(high, 0) - np.min(low, 0)
    turn = np.sqrt((off**2).mean()) / max(np.linalg.norm(setup.robot.gravity), 1e-9)
    return RangeOfMotion(float(turn), float(off.max()), float(np.nanmax(travel)))


def _degrees(turn: float) -> str:
    return f"{round(float(np.degrees(turn)), 5):.2g}"
