"""Alternatives in which the sensor is mounted differently from what the setup states."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations, product
from typing import Any

import numpy as np

from ftbias_jax.check.regression import without_bias
from ftbias_jax.check.state import Alternative, State
from ftbias_jax.setup.rotations import rotation_from_rpy, rpy_from_rotation
from ftbias_jax.types import Array

OTHER_REPORT = {"wrench_on_tool": "wrench_on_sensor", "wrench_on_sensor": "wrench_on_tool"}
ROTATIONS = [
    P
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3))
    if np.linalg.det(P := np.eye(3)[list(order)] * signs) > 0
]
"""R_stated_sensor of every mount whose axes are parallel to the stated ones."""
MOST_RPY = 3.2
"""rad; roll, pitch and yaw need not be larger."""
LEAST_TURN = np.radians(25.0)
"""rad; a smaller rotation of the sensor is an effect (mount_rotation), not a mistake."""
LEAST_ALIKE = 0.5
"""Correlation of the rotated reading with the tool's force below which a permutation need not be fitted."""
ALIGNED = 0.9
"""Least correlation of the rotated reading with the tool's force for another direction of gravity to be tried."""
DOWN = [sign * 9.81 * axis + 0.0 for axis in np.eye(3)[::-1] for sign in (-1.0, 1.0)]
"""(3,) m/s^2 of bases that stand, hang, or are mounted on a wall."""
SPIKE = 4.0
"""Multiple of the median reading beyond which a bin is ignored in the estimate of the rotation."""


def mounts(state: State) -> Iterator[Alternative]:
    """Yield the 24 mounts with axes parallel to the stated ones, with either sign of the report, and the best rotation.

    No sensor has mirrored axes: columns that look mirrored are those of a rotated sensor with the opposite sign.
    """
    touched = state.case.layout.touched
    overlap, sizes = _overlap(state, slice(0, 3))
    for P, sign in product(ROTATIONS, (1.0, -1.0)):
        if np.array_equal(P, np.eye(3)):
            continue  # the stated mount, or the mistake 'sign'
        if touched or sign * (P * overlap).sum() >= LEAST_ALIKE * sizes:
            yield from _parallel(state, P, sign)
    yield from _turned_freely(state)
    yield from _turned_on_another_base(state)


def mount_in_degrees(state: State) -> Iterator[Alternative]:
    """Yield the alternative that the sensor's rotation was written in degrees; nothing if its angles are small."""
    sensor = state.case.setup.sensor
    written = sensor.rotation_rpy
    if written is None or np.abs(written).max() <= MOST_RPY:
        return
    if np.allclose(rotation_from_rpy(written), sensor.rotation):  # nothing has replaced the rotation since
        yield Alternative(
            "angle_units",
            "sensor.rotation_rpy is in degrees: give rad",
            turned_mount(state, sensor.rotation.T @ rotation_from_rpy(np.radians(written))),
            2,
            setup={"sensor.rotation_rpy": [float(x) for x in np.radians(written)]},
        )


def turned_mount(state: State, turned: Array) -> State:
    """Return the state with the sensor's axes rotated on the flange: R v_turned = v_stated."""
    rotation = state.motion.rotation @ turned
    force = None if state.specific_force is None else state.specific_force @ turned
    return state.but(motion=state.motion._replace(rotation=rotation), specific_force=force)


def _parallel(state: State, P: Array, sign: float) -> Iterator[Alternative]:
    """Yield a mount with parallel axes, with the tool given along the stated axes and along those of the sensor."""
    half_turn = np.trace(P) == -1
    rank = 5 + 0.3 * (P[2, 2] != 1) + 0.2 * (not half_turn) + (sign < 0)
    yield _mount(state, P, rank, sign)
    mounted, (words, values) = turned_mount(state, P), _turned(state, P, sign)
    yield Alternative("sensor_axes", words, mounted.but(wrench=sign * mounted.wrench), rank + 0.05, setup=values)


def _turned_freely(state: State) -> Iterator[Alternative]:
    """Yield the rotation that best aligns the reading with the stated tool's wrench, or its force alone.

    The force determines the rotation regardless of the centre of mass.
    """
    if state.case.layout.touched:
        return  # too few bins are kept to fit three more parameters
    force, torque = (_overlap(state, axes) for axes in (slice(0, 3), slice(3, 6)))
    for rank, overlap in enumerate((force[0] / force[1] + torque[0] / torque[1], force[0]), 7):
        P = _nearest_rotation(overlap)
        if np.trace(P) < 1 + 2 * np.cos(LEAST_TURN):
            yield _mount(state, P, rank)


def _turned_on_another_base(state: State) -> Iterator[Alternative]:
    """Yield the rotation that best aligns the forces if gravity has another direction, or the report another sign.

    Of an arm on a ceiling whose sensor is turned by 30 degrees, neither gravity nor the mount alone explains the force.
    """
    if state.case.layout.touched or state.specific_force is not None:
        return
    for gravity, sign in product(DOWN, (1.0, -1.0)):
        elsewhere = bool(np.linalg.norm(gravity - state.gravity) > 1)
        if not elsewhere and sign > 0:
            continue
        other = state.but(gravity=gravity) if elsewhere else state
        overlap, sizes = _overlap(other, slice(0, 3))
        P = _nearest_rotation(sign * overlap)
        if sign * (P * overlap).sum() < ALIGNED * sizes or np.trace(P) > 1 + 2 * np.cos(LEAST_TURN):
            continue
        # It has so many ways that one of them may resemble a log that something pushes.
        one = replace(_mount(other, P, 8 + elsewhere + (sign < 0), sign), like_tool=False)
        if elsewhere:
            words = f"the base is not level: set robot.gravity = {gravity.tolist()}, and {one.remedy}"
            one = replace(one, remedy=words, setup={**(one.setup or {}), "robot.gravity": gravity.tolist()})
        yield one


def _nearest_rotation(overlap: Array) -> Array:
    """Rotation P (3, 3) with the largest inner product with an overlap (Kabsch 1976)."""
    U, _, V = np.linalg.svd(overlap)
    rotation: Array = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ V))]) @ V
    return rotation


def _overlap(state: State, axes: slice) -> tuple[Array, float]:
    """Sum of (stated tool's wrench) (reading)^T (3, 3) without bias and spikes, and the product of their norms."""
    layout = state.case.layout
    tool, reading = (without_bias(x[:, axes], layout) for x in (state.of_tool, state.wrench))
    size = np.linalg.norm(reading, axis=1)
    rows = size < SPIKE * np.median(size) + 1e-12
    return tool[rows].T @ reading[rows], float(np.linalg.norm(tool[rows]) * np.linalg.norm(reading[rows])) + 1e-12


def _mount(state: State, P: Array, rank: float, sign: float = 1.0) -> Alternative:
    """Return the alternative of another mount P, with the tool given along the stated axes: P v_reading = v_stated."""
    words, values = _turned(state, P, sign)
    if state.case.center_is_measured:
        center = P.T @ state.case.setup.tool.center_of_mass
        values |= {"tool.center_of_mass": _list(center)}
        words += f", and tool.center_of_mass = {_plain(center)} if it was meant along the axes as stated"
    wrench = sign * np.concatenate([state.wrench[:, :3] @ P.T, state.wrench[:, 3:] @ P.T], 1)
    return Alternative("sensor_axes", words, state.but(wrench=wrench), rank, setup=values)


def _turned(state: State, P: Array, sign: float) -> tuple[str, dict[str, Any]]:
    """Message and setup keys for a sensor that is rotated on the flange and may report the opposite sign."""
    sensor = state.case.setup.sensor
    rpy, other = rpy_from_rotation(sensor.rotation @ P), OTHER_REPORT[sensor.reports]
    words = f"the sensor is turned on the flange: set sensor.rotation_rpy = {_plain(rpy)}"
    if sign > 0:
        return words, {"sensor.rotation_rpy": _list(rpy)}
    return f'{words}, sensor.reports = "{other}"', {"sensor.reports": other, "sensor.rotation_rpy": _list(rpy)}


def _list(values: Array) -> list[float]:
    return [float(f"{x:.6g}") + 0.0 for x in values]


def _plain(values: Array) -> str:
    return "[" + ", ".join(f"{round(float(x), 6) + 0.0:.4g}" for x in values) + "]"
