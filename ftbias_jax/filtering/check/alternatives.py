"""The mistakes that people make in a setup, each as what would be true instead."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations, product

import numpy as np

from ftbias_jax.filtering.check.motion import arm_motion
from ftbias_jax.filtering.check.regression import Tool
from ftbias_jax.filtering.check.state import Alternative, State
from ftbias_jax.setup.rotations import rotation_from_rpy, rpy_from_rotation
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

G = 9.80665
UNITS = {
    "kilogram-force": (1 / G, "multiply force and torque by 9.80665"),
    "pound-force": (1 / 4.4482216, "multiply force and torque by 4.44822"),
    "gram-force": (1e3 / G, "multiply force and torque by 0.00980665"),
    "millinewton": (1e3, "divide force and torque by 1000"),
}
"""Unit of force -> how many of it are one newton, and what to do; the torque is in the same unit times a metre."""
TORQUE_UNITS = {
    "Nmm": (1e3, "divide the torque by 1000"),
    "Ncm": (1e2, "divide the torque by 100"),
    "mNm": (1e3, "divide the torque by 1000"),
    "kgf m": (1 / G, "multiply the torque by 9.80665"),
    "lbf in": (8.8507458, "multiply the torque by 0.112985"),
    "lbf ft": (0.7375621, "multiply the torque by 1.35582"),
}
MOST_RPY = 3.2
"""rad: no angle need be larger."""
OTHER = {"wrench_on_tool": "wrench_on_sensor", "wrench_on_sensor": "wrench_on_tool"}
AXIS_NAMES = "xyz"


def all_alternatives(state: State) -> Iterator[Alternative]:
    """Every alternative to a state that is but one mistake away; recorded poses have more (``poses``)."""
    setup = state.case.setup
    yield _sign(state)
    yield from _wrench_units(state)
    yield from _tool_units(state)
    yield from _degrees(state)
    yield from _gravity(state)
    if state.case.layout.axes.all():
        yield _swapped(state)
        yield from _base_frame(state)
        yield from _sensor_axes(state, setup)


def _sign(state: State) -> Alternative:
    other = OTHER[state.case.setup.sensor.reports]
    return Alternative(
        "sign",
        f'the sensor reports the {other.replace("_", " ")}: set sensor.reports = "{other}"',
        state.but(wrench=-state.wrench),
        0,
        setup={"sensor.reports": other},
    )


def _wrench_units(state: State) -> Iterator[Alternative]:
    pairs = [(name, (scale, scale), words) for name, (scale, words) in UNITS.items()]
    pairs += [("kgf and kgf cm", (1 / G, 100 / G), "multiply force by 9.80665 and torque by 0.0980665")]
    pairs += [("lbf and lbf in", (1 / 4.4482216, 8.8507458), "multiply force by 4.44822 and torque by 0.112985")]
    pairs += [(name, (1.0, scale), words) for name, (scale, words) in TORQUE_UNITS.items()]
    pairs += [("N and newtons of another unit of torque", (1e3, 1e6), "divide force by 1000 and torque by a million")]
    for name, scales, words in pairs:
        yield Alternative(
            "wrench_units",
            f"the wrench is in {name} instead of N and Nm: {words} before filtering",
            state.but(wrench=state.wrench / np.repeat(scales, 3), unit=state.unit * scales),
            1,
            groups=(1,) if scales[0] == 1 else (0,),
            scale=True,
        )


def _tool_units(state: State) -> Iterator[Alternative]:
    tool = state.case.setup.tool
    for mass, length, words in (
        (1e-3, 1.0, "tool.mass is in g"),
        (1.0, 1e-3, "tool.center_of_mass is in mm"),
        (1e-3, 1e-3, "tool.mass is in g and tool.center_of_mass in mm"),
        (1.0, 1e-2, "tool.center_of_mass is in cm"),
    ):
        center = tool.center_of_mass * length
        m = tool.mass * mass
        theta = np.concatenate([[m], m * center, np.zeros(6)])
        size = np.linalg.norm(center)
        moment, inertia = m * (0.04 + 0.5 * size), m * (0.1 + size) ** 2
        reach = np.concatenate([[0.25 * m], np.full(3, moment), np.full(6, inertia)])
        values: dict[str, float | list[float]] = {"tool.mass": m} if mass != 1 else {}
        if length != 1:
            values["tool.center_of_mass"] = [float(f"{x:.6g}") for x in center]
        yield Alternative(
            "tool_units",
            f"{words}: give kg and m (inertia in kg m^2)",
            state.but(tool=Tool(theta, reach)),
            1.5,
            groups=(1,) if mass == 1 else (0,),
            setup=values,
            scale=True,
        )


def _degrees(state: State) -> Iterator[Alternative]:
    case = state.case
    setup, bins = case.setup, case.bins
    if setup.pose is not None:
        return
    turning = setup.robot.screws[:, 3:].any(1)
    factor = np.where(turning, np.pi / 180, 1)
    with_rates = ((1.0, "q and dq are"), (180 / np.pi, "q is"))
    for rate, words in with_rates:
        motion = arm_motion(
            setup.robot, setup.sensor, *(x * factor * y for x, y in ((bins.q, 1.0), (bins.dq, rate), (bins.ddq, rate)))
        )
        yield Alternative(
            "angle_units",
            f"{words} in degrees: convert to rad and rad/s before filtering",
            state.but(motion=motion),
            2,
        )
        if not np.isfinite(bins.dq).any():
            break
    stated = setup.sensor.rotation_rpy
    if (
        stated is not None
        and np.abs(stated).max() > MOST_RPY
        and np.allclose(rotation_from_rpy(stated), setup.sensor.rotation)
    ):
        turned = setup.sensor.rotation.T @ rotation_from_rpy(np.radians(stated))
        yield Alternative(
            "angle_units",
            "sensor.rotation_rpy is in degrees: give rad",
            turned_mount(state, turned),
            2,
            setup={"sensor.rotation_rpy": [float(x) for x in np.radians(stated)]},
        )


def _gravity(state: State) -> Iterator[Alternative]:
    if state.specific_force is not None:
        return  # an accelerometer has gravity in it
    standard = np.allclose(state.gravity, [0, 0, -9.81], atol=0.1)
    for axis, sign in product(range(3), (-1.0, 1.0)):
        gravity = sign * 9.81 * np.eye(3)[axis]
        if np.linalg.norm(gravity - state.gravity) < 1:
            continue
        yield Alternative(
            "gravity",
            f"gravity points along {'+' if sign > 0 else '-'}{AXIS_NAMES[axis]} of the base frame: "
            f"set robot.gravity = {gravity.tolist()}",
            state.but(gravity=gravity),
            4 if standard else -1,
            setup={"robot.gravity": gravity.tolist()},
        )


def _swapped(state: State) -> Alternative:
    return Alternative(
        "force_torque_swapped",
        "the first three columns of the wrench are the torque: give force, then torque",
        state.but(wrench=state.wrench[:, [3, 4, 5, 0, 1, 2]], unit=state.unit[::-1].copy(), swapped=not state.swapped),
        2,
    )


def _sensor_axes(state: State, setup: Setup) -> Iterator[Alternative]:
    """Signed permutations: proper ones are another mount, the others columns with a wrong sign or order."""
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        P = np.eye(3)[list(order)] * signs
        proper = np.linalg.det(P) > 0
        about_z = P[2, 2] == 1
        half_turn = np.trace(P) == -1 and np.array_equal(P, P.T)
        for torque in (1.0, -1.0):
            if np.array_equal(P, np.eye(3)) or (np.array_equal(P, -np.eye(3)) and torque == 1):
                continue  # the stated one, one that only the torque shows; -I with the same torque sign is 'sign'
            wrench = np.concatenate([state.wrench[:, :3] @ P.T, torque * state.wrench[:, 3:] @ P.T], 1)
            simple = proper and torque == 1
            rank = 5 + 0.3 * (not about_z) + 0.2 * (not half_turn) + (0 if simple else 1)
            if simple:
                rotation = setup.sensor.rotation @ P
                rpy = rpy_from_rotation(rotation)
                words = f"the sensor is turned on the flange: set sensor.rotation_rpy = {_plain(rpy)}"
                center = P.T @ setup.tool.center_of_mass
                values = {"sensor.rotation_rpy": _list(rpy), "tool.center_of_mass": _list(center)}
                remedy = f"{words}, and tool.center_of_mass = {_plain(center)} if it was meant along the axes as stated"
                yield Alternative("sensor_axes", remedy, state.but(wrench=wrench), rank, setup=values)
                yield Alternative(
                    "sensor_axes",
                    words,
                    turned_mount(state, P),
                    rank + 0.05,
                    setup={"sensor.rotation_rpy": _list(rpy)},
                )
            else:
                yield Alternative("sensor_axes", _columns(P, torque), state.but(wrench=wrench), rank)


def _base_frame(state: State) -> Iterator[Alternative]:
    R = state.motion.rotation
    force, torque = state.wrench[:, :3], state.wrench[:, 3:]
    about_base = torque - np.cross(state.motion.position, force)
    for words, moment in (("about the sensor", torque), ("about the base", about_base)):
        turned = np.concatenate([np.einsum("nji,nj->ni", R, x) for x in (force, moment)], 1)
        yield Alternative(
            "base_frame_wrench",
            f"the wrench has the axes of the base frame, torque {words}: record it in the sensor's own frame",
            state.but(wrench=turned),
            3.5,
        )


def turned_mount(state: State, turned: Array) -> State:
    """The state with the sensor's axes turned on the flange: R v_turned = v_stated."""
    rotation = state.motion.rotation @ turned
    force = None if state.specific_force is None else state.specific_force @ turned
    return state.but(motion=state.motion._replace(rotation=rotation), specific_force=force)


def _columns(P: Array, torque: float) -> str:
    """What stands in the columns, in words."""
    read = []
    for row in P:
        axis = int(np.abs(row).argmax())
        read.append(f"{'-' if row[axis] < 0 else ''}{AXIS_NAMES[axis]}")
    more = "" if torque > 0 else ", the torque with the opposite signs"
    return f"the axes of the wrench are not those of the sensor: x, y, z are its columns {', '.join(read)}{more}"


def _list(values: Array) -> list[float]:
    return [float(f"{x:.6g}") + 0.0 for x in values]


def _plain(values: Array) -> str:
    return "[" + ", ".join(f"{x + 0.0:.4g}" for x in np.atleast_1d(np.round(values, 6))) + "]"
