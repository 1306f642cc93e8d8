"""Mistakes that the logs could not reveal, because their motion does not distinguish them from a correct setup.

Each mistake is simulated: what would the sensor read if the tool is as stated and the mistake was made? If the setup
explains that reading as well, or if it is lost in the residual, the mistake would not be reported.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ftbias_jax.check import findings, poses
from ftbias_jax.check.alternatives import G, degrees
from ftbias_jax.check.judge import ABSENT, BAD, BETTER, CLEAR, GOOD, GOOD_STRICT, TIE, Evidence, noise_of_bins
from ftbias_jax.check.motion import data_matrices, in_sensor
from ftbias_jax.check.regression import BLOCKS, squares, within_reach, without_bias
from ftbias_jax.check.result import MISTAKES, Undetermined
from ftbias_jax.check.state import State, delayed
from ftbias_jax.types import Array

TURN = (
    "turn the sensor by 30 degrees or more about two horizontal axes, with a tool on that weighs more than the noise, "
    "and touch nothing"
)
ACCELERATE = "move the sensor there and back in a few seconds while it turns, and touch nothing"
ALL_AXES = "record all six axes of the wrench"
TOOL = "state the tool's mass and centre of mass"
HEAVIER = "put a tool on whose weight is larger than bias.initial_std, or state a smaller one"
LONGER = "record motion and wrench together for at least 5 s"
RAW = "record the wrench from which nothing has been subtracted"
DELAY = 0.5
"""s; simulated difference of the clocks."""
TURNS = (
    np.diag([-1.0, -1, 1]),
    np.diag([1.0, -1, -1]),
    np.diag([-1.0, 1, -1]),
    np.array([[0, -1.0, 0], [1, 0, 0], [0, 0, 1]]),
)
"""Simulated wrong mounts: half turns about each axis, and a quarter turn."""
OF_JOINTS = ("joint_convention",)
OF_POSE = ("quaternion_convention", "position_frame", "gyroscope_units")
OF_ARM = tuple(name for name in MISTAKES if name not in OF_POSE)


@dataclass(frozen=True, eq=False)
class Imagined:
    """Residual of a correct setup, and the residual that it would leave of a reading with a mistake in it."""

    state: State
    columns: Array
    """(N, 6, 10) data matrix D of the state, without bias and drift."""
    wrench: Array
    """(N, 6) N, Nm, wrench of the nominal tool, from which bias and drift are not removed."""
    floor: Array
    """(2,) N^2, Nm^2: residual of the state on the actual reading, noise and contact included."""

    def of(self, reading: Array, floor: Array | None = None) -> tuple[float, float, float]:
        """Mean squares of force: the setup's residual on a reading (N, 6), the reading itself, and the floor."""
        floor = self.floor if floor is None else floor
        free = without_bias(reading, self.state.case.layout)
        return float(self.left(free)[0] + floor[0]), float(squares(free)[:, 0].mean() + floor[0]), float(floor[0])

    def left(self, free: Array) -> Array:
        """(2,) mean squared residual of a tool near the nominal one on a reading (N, 6) without bias."""
        size = np.repeat(np.sqrt(squares(free).mean(0)) + 1e-12, 3)
        X, y = (self.columns / size[:, None]).reshape(-1, 10), (free / size).reshape(-1)
        theta = within_reach(X.T @ X, X.T @ y, self.state.tool)
        return squares(free - self.columns @ theta).mean(0)

    def is_detectable(self, reading: Array, floor: Array | None = None) -> bool:
        """Return whether a mistake that makes the sensor read this (N, 6) would be reported."""
        stated, raw, right = self.of(reading, floor)
        good = GOOD_STRICT if self.state.case.layout.touched else GOOD
        return stated > BAD * raw and right < BETTER * stated and right < good * raw


def undetermined(base: Evidence, *, tool_is_stated: bool) -> tuple[Undetermined, ...]:
    """Mistakes that the logs could not reveal, with the mistakes that were found corrected.

    Where the tool is not stated, the one fitted to the logs is used, and units of force cannot be determined.
    """
    state = base.state
    setup = state.case.setup
    if setup.sensor.compensated != "none":
        names = set(names_for(setup.pose is not None)) - {"raw_offset", "rezeroed", "compensated"}
        return _sorted(dict.fromkeys(names, RAW))
    columns, wrench = state.data, state.of_tool
    left = base.result.square[::-1] if state.swapped else base.result.square
    floor = np.maximum(left / state.unit**2, noise_of_bins(state) ** 2)
    columns = without_bias(columns * state.case.layout.axes[:, None], state.case.layout)
    imagined = Imagined(state, columns, wrench * state.case.layout.axes, floor)
    found = dict(_unseen(imagined))
    if not tool_is_stated:
        found |= dict.fromkeys(("wrench_units", "tool_units"), TOOL)
    if setup.pose is not None:
        found |= dict(_unseen_of_pose(imagined))
    return _sorted(found)


def all_undetermined(*, pose: bool) -> tuple[Undetermined, ...]:
    """All mistakes, for logs that are too short to show any; ``pose``: whether they have a pose instead of joints."""
    return _sorted(dict.fromkeys(names_for(pose), LONGER))


def names_for(pose: bool) -> tuple[str, ...]:
    """Names of the mistakes that are checked with a recorded pose or with joints."""
    return tuple(name for name in MISTAKES if name not in OF_JOINTS) if pose else OF_ARM


def _unseen(imagined: Imagined) -> Iterator[tuple[str, str]]:
    """Yield mistakes possible in any log that would not be reported, each with its remedy."""
    state, M = imagined.state, imagined.wrench
    layout = state.case.layout
    if not imagined.is_detectable(-M):
        angles = ("angle_units",) if next(degrees(state), None) else ()
        joints = OF_JOINTS if state.case.setup.pose is None else ()
        yield from dict.fromkeys(("sign", "wrench_units", "tool_units", *joints, *angles), TURN).items()
    elif not imagined.is_detectable(G * M, G**2 * imagined.floor):
        yield "wrench_units", TURN
    if state.specific_force is None:
        down = np.linalg.norm(state.gravity)
        others = [-state.gravity, *(down * axis for axis in np.eye(3) if abs(axis @ state.gravity) < 0.9 * down)]
        if not all(imagined.is_detectable(data_matrices(state.motion, g) @ state.tool.theta) for g in others):
            yield "gravity", TURN
    force = M.reshape(-1, 2, 3)
    if not layout.axes.all():
        yield from dict.fromkeys(("force_torque_swapped", "sensor_axes", "base_frame_wrench"), ALL_AXES).items()
    else:
        if not imagined.is_detectable(M[:, [3, 4, 5, 0, 1, 2]], imagined.floor[::-1]):
            yield "force_torque_swapped", TURN
        if not all(imagined.is_detectable((force @ P).reshape(-1, 6)) for P in TURNS):
            yield "sensor_axes", TURN
        if not _base_frame_is_seen(imagined):
            yield "base_frame_wrench", TURN
    yield from _unseen_weight(imagined)
    late = imagined.of(delayed(state.case, M, DELAY))
    enough = late[0] > findings.OFFSET_BAD * late[1] and late[2] < findings.OFFSET_BETTER * late[0]
    if layout.touched or not enough or late[2] > GOOD * late[1]:
        yield "time_offset", ACCELERATE


def _unseen_weight(imagined: Imagined) -> Iterator[tuple[str, str]]:
    """Yield mistakes that would not be reported because the tool's wrench is constant or too small."""
    state = imagined.state
    size, noise = squares(without_bias(imagined.wrench, state.case.layout)).mean(0), noise_of_bins(state)
    clear = np.sqrt(size) > CLEAR * noise
    # Two standard errors, over the blocks, of a share whose true value is zero.
    if not clear[0] or 2 * np.sqrt(imagined.floor[0] / size[0] / BLOCKS) > ABSENT:
        yield "compensated", TURN
    if not clear.any():
        yield "worse_than_raw", TURN
    if not state.case.setup.sensor.rezeroed and not findings.zero_would_show(state):
        yield "rezeroed", HEAVIER


def _base_frame_is_seen(imagined: Imagined) -> bool:
    """Return whether a base-frame wrench would be reported: its weight does not turn, so only small changes show."""
    turned = np.einsum("nij,nkj->nki", imagined.state.motion.rotation, imagined.wrench.reshape(-1, 2, 3))
    free = without_bias(turned.reshape(-1, 6), imagined.state.case.layout)
    raw, stated = squares(free).mean(0) + imagined.floor, imagined.left(free) + imagined.floor
    enough = stated[0] > BAD * raw[0] and imagined.floor[0] < BETTER * stated[0]
    return bool(enough and -np.log(imagined.floor / raw).sum() > TIE)


def _unseen_of_pose(imagined: Imagined) -> Iterator[tuple[str, str]]:
    """Yield mistakes of a recorded pose that would not be reported, each with its remedy."""
    state = imagined.state
    for convention, other in poses.conventions(state):
        if sum(vars(convention).values()) != 1:
            continue
        stated, raw, right = imagined.of(other.data @ state.tool.theta)
        if right > poses.POSE_BETTER * stated or right > BAD * raw:
            yield ("position_frame", ACCELERATE) if convention.in_body else ("quaternion_convention", TURN)
    turning = in_sensor(state.motion, state.motion.velocity)
    if state.case.bins.gyroscope is not None and np.sqrt((turning**2).sum(1).mean()) < poses.TURNING:
        yield "gyroscope_units", TURN


def _sorted(remedies: dict[str, str]) -> tuple[Undetermined, ...]:
    order = (*OF_ARM, *OF_POSE)
    return tuple(Undetermined(name, remedies[name]) for name in sorted(remedies, key=order.index))
