"""Common mistakes in a setup, each formulated as the alternative model that would hold if it had been made."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np

from ftbias_jax.check.motion import arm_motion
from ftbias_jax.check.mounts import DOWN, LEAST_TURN, OTHER_REPORT, mount_in_degrees, mounts
from ftbias_jax.check.regression import Tool, stated_tool, without_bias
from ftbias_jax.check.state import FARTHEST, LIGHTEST, Alternative, State
from ftbias_jax.types import AXES, Array

G, LBF, LBF_IN = 9.80665, 4.4482216, 8.8507458
"""N in a kilogram-force, N in a pound-force, and pound-force inches in 1 Nm."""
UNITS = {
    "kilogram-force": (1 / G, 1 / G, "multiply force and torque by 9.80665"),
    "pound-force": (1 / LBF, 1 / LBF, "multiply force and torque by 4.44822"),
    "gram-force": (1e3 / G, 1e3 / G, "multiply force and torque by 0.00980665"),
    "millinewton": (1e3, 1e3, "divide force and torque by 1000"),
    "kgf and kgf cm": (1 / G, 100 / G, "multiply force by 9.80665 and torque by 0.0980665"),
    "lbf and lbf in": (1 / LBF, LBF_IN, "multiply force by 4.44822 and torque by 0.112985"),
    "kgf and Nm": (1 / G, 1.0, "multiply the force by 9.80665"),
    "lbf and Nm": (1 / LBF, 1.0, "multiply the force by 4.44822"),
    "lbf and lbf ft": (1 / LBF, 0.7375621, "multiply force by 4.44822 and torque by 1.35582"),
    "mN and Nm": (1e3, 1.0, "divide the force by 1000"),
    "Nmm": (1.0, 1e3, "divide the torque by 1000"),
    "Ncm": (1.0, 1e2, "divide the torque by 100"),
    "mNm": (1.0, 1e3, "divide the torque by 1000"),
    "kgf m": (1.0, 1 / G, "multiply the torque by 9.80665"),
    "lbf in": (1.0, LBF_IN, "multiply the torque by 0.112985"),
    "lbf ft": (1.0, 0.7375621, "multiply the torque by 1.35582"),
    "N and newtons of another unit of torque": (1e3, 1e6, "divide force by 1000 and torque by a million"),
}
"""Name of units -> number of them in 1 N and in 1 Nm, and the remedy."""
LEAST_OPPOSITE = 0.5
"""Correlation of a channel with minus the tool's wrench below which its sign need not be tried."""
NEARLY_ALL = 0.85
"""Share of the tool's mass beyond which a payload whose weight was subtracted is the tool."""
LEAST_DEGREES = 7.0
"""If no recorded angle of a revolute joint exceeds this value, whatever its unit, the angles are not in degrees."""


def all_alternatives(state: State) -> Iterator[Alternative]:
    """Yield every alternative that differs from a state by one mistake; those of recorded poses are in ``poses``."""
    yield _sign(state)
    yield from sign_of_one(state)
    yield from _wrench_units(state)
    yield from _tool_units(state)
    yield from degrees(state)
    yield from mount_in_degrees(state)
    yield from _gravity(state)
    yield from hanging(state)
    yield from _other_payload(state)
    yield from _joints(state)
    if state.case.layout.axes.all():
        yield _swapped(state)
        yield from _base_frame(state)
        yield from mounts(state)


def _sign(state: State) -> Alternative:
    other = OTHER_REPORT[state.case.setup.sensor.reports]
    return Alternative(
        "sign",
        f'the sensor reports the {other.replace("_", " ")}: set sensor.reports = "{other}"',
        state.but(wrench=-state.wrench),
        0,
        setup={"sensor.reports": other},
    )


def sign_of_one(state: State) -> Iterator[Alternative]:
    """Yield alternatives in which one channel has the opposite sign, as after a wrong axis in a driver."""
    layout = state.case.layout
    tool, reading = (without_bias(x, layout) for x in (state.of_tool, state.wrench))
    sizes = np.linalg.norm(tool, axis=0) * np.linalg.norm(reading, axis=0)
    for channel in np.flatnonzero(layout.axes & ((tool * reading).sum(0) < -LEAST_OPPOSITE * sizes)):
        words = f"{AXES[channel]} has the opposite sign: negate its column in the log"
        wrench = state.wrench * np.where(np.arange(len(AXES)) == channel, -1, 1)
        groups = (int(channel) // 3,)
        yield Alternative("sign", words, state.but(wrench=wrench), 3, groups=groups, like_tool=False)


def _wrench_units(state: State) -> Iterator[Alternative]:
    for name, (*scales, words) in UNITS.items():
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
        center, m = tool.center_of_mass * length, tool.mass * mass
        other = stated_tool(replace(tool, mass=m, center_of_mass=center, inertia=np.zeros(6)))
        theta = np.concatenate([other.theta[:4], np.zeros(6)])
        values: dict[str, float | list[float]] = {"tool.mass": m} if mass != 1 else {}
        if length != 1:
            values["tool.center_of_mass"] = [float(f"{x:.6g}") for x in center]
        yield Alternative(
            "tool_units",
            f"{words}: give kg and m (inertia in kg m^2)",
            state.but(tool=Tool(theta, other.reach)),
            1.5,
            groups=(1,) if mass == 1 else (0,),
            setup=values,
            scale=True,
        )


def degrees(state: State) -> Iterator[Alternative]:
    """Yield alternatives with joints recorded in degrees, all of them or one; none if their values are too small."""
    case = state.case
    setup, bins = case.setup, case.bins
    turning = setup.robot.revolute
    if setup.pose is not None or not (np.abs(bins.q[:, turning]) > LEAST_DEGREES).any():
        return
    names, large = setup.robot.joint_names, turning & (np.abs(bins.q) > LEAST_DEGREES).any(0)
    for joint in np.flatnonzero(large) if turning.sum() > 1 else ():
        factor = np.where(np.arange(len(names)) == joint, np.pi / 180, 1)
        words = f"{names[joint]} is in degrees, the other joints are not: convert it to rad before filtering"
        moved = _with_joints(state, *(x * factor for x in (bins.q, bins.dq, bins.ddq)))
        yield Alternative("angle_units", words, moved, 2.5)
    factor = np.where(turning, np.pi / 180, 1)
    both = 'q and dq are in degrees: set log.angle_unit = "deg"'
    only = "q is in degrees, dq is not: convert q to rad before filtering"
    for rate, words, mend in ((1.0, both, {"log.angle_unit": "deg"}), (180 / np.pi, only, {})):
        moved = _with_joints(state, bins.q * factor, *(x * factor * rate for x in (bins.dq, bins.ddq)))
        yield Alternative("angle_units", words, moved, 2, setup=mend)
        if not case.moves:
            break


def _joints(state: State) -> Iterator[Alternative]:
    """Yield alternatives in which two joints of the log are swapped, or one has the opposite sign or another zero."""
    setup, bins = state.case.setup, state.case.bins
    if setup.pose is not None:
        return
    names, number = setup.robot.joint_names, np.arange(len(setup.robot.joint_names))
    for pair in combinations(number, 2):
        order = number.copy()
        order[list(pair)] = pair[::-1]
        words = f"{names[pair[0]]} and {names[pair[1]]} have changed places: give them in the order of the setup"
        yield _moved(state, words, *(x[:, order] for x in (bins.q, bins.dq, bins.ddq)))
    for joint, name in enumerate(names):
        words = f"{name} moves the other way: negate its column in the log, or its axis in the setup"
        yield _moved(state, words, *(x * np.where(number == joint, -1, 1) for x in (bins.q, bins.dq, bins.ddq)))
        for angle in (90, 180, -90) if setup.robot.screws[joint, 3:].any() else ():
            words = f"the zero of {name} is {angle} degrees off: add these to it in the log"
            yield _moved(state, words, bins.q + np.radians(angle) * (number == joint), bins.dq, bins.ddq)


def _moved(state: State, words: str, q: Array, dq: Array, ddq: Array) -> Alternative:
    """Build the ``joint_convention`` alternative with this joint motion."""
    return Alternative("joint_convention", words, _with_joints(state, q, dq, ddq), 6)


def _with_joints(state: State, q: Array, dq: Array, ddq: Array) -> State:
    """Return the state with the sensor moved by this joint motion."""
    return state.but(motion=arm_motion(state.case.setup.robot, state.case.setup.sensor, q, dq, ddq))


def _gravity(state: State) -> Iterator[Alternative]:
    if state.specific_force is not None:
        return  # an accelerometer already measures gravity
    for gravity in DOWN:
        if np.linalg.norm(gravity - state.gravity) < 1:
            continue
        axis = int(np.abs(gravity).argmax())
        yield Alternative(
            "gravity",
            f"gravity points along {'+' if gravity[axis] > 0 else '-'}{'xyz'[axis]} of the base frame: "
            f"set robot.gravity = {gravity.tolist()}",
            state.but(gravity=gravity),
            -1 if gravity[2] < 0 else 4,  # nearly all arms stand on a floor
            setup={"robot.gravity": gravity.tolist()},
        )
    if not state.case.moves:
        yield from _any_gravity(state)


def hanging(state: State) -> Iterator[Alternative]:
    """Yield the alternative that gravity and the sensor's sign are both opposite: accelerations alone show it."""
    if state.specific_force is not None:
        return
    other, gravity = OTHER_REPORT[state.case.setup.sensor.reports], (0.0 - state.gravity).tolist()
    yield Alternative(
        "gravity",
        f"gravity points the other way, and the sensor reports the other sign: set robot.gravity = {gravity} and "
        f'sensor.reports = "{other}"',
        state.but(gravity=-state.gravity, wrench=-state.wrench),
        4.2,
        setup={"robot.gravity": gravity, "sensor.reports": other},
        like_tool=False,
    )


def _other_payload(state: State) -> Iterator[Alternative]:
    """Yield the alternative that the controller has subtracted the weight of a payload which is not the tool."""
    layout, support = state.case.layout, -np.einsum("nji,j->ni", state.motion.rotation, state.gravity)
    columns = np.zeros((len(support), 6, 4))  # of its mass, kg, and its first moment, kg m
    columns[:, :3, 0] = support
    columns[:, 3:, 1:] = np.cross(np.eye(3), support[:, None]).transpose(0, 2, 1)
    weight = layout.axes / state.case.setup.sensor.noise_std
    design, missing = (without_bias(x, layout) for x in (columns, state.of_tool - state.wrench))
    rows = (design * weight[:, None]).reshape(-1, 4), (missing * weight).reshape(-1)
    mass, *moment = np.linalg.lstsq(*rows, rcond=None)[0]
    if not LIGHTEST < mass < NEARLY_ALL * state.tool.theta[0] or np.linalg.norm(moment) > FARTHEST * mass:
        return
    place = ", ".join(f"{x / mass:.3f}" for x in moment)
    yield Alternative(
        "compensated",
        f"the controller has subtracted the weight of {mass:.3g} kg at [{place}] m, which is not the tool: record the "
        "raw wrench, or set the controller's payload to zero",
        state.but(wrench=state.wrench + columns @ np.array([mass, *moment])),
        3,
        like_tool=False,
    )


def _any_gravity(state: State) -> Iterator[Alternative]:
    """Yield the gravity direction that best fits poses at rest; in motion, a constant external force would mimic it."""
    layout = state.case.layout
    axes, force = (without_bias(x, layout) for x in (state.motion.rotation.transpose(0, 2, 1), state.wrench[:, :3]))
    weight = np.linalg.lstsq(axes.reshape(-1, 3), force.reshape(-1), rcond=None)[0]
    size = np.linalg.norm(state.gravity)
    gravity = -size * weight / max(np.linalg.norm(weight), 1e-12)
    if gravity @ state.gravity < np.cos(LEAST_TURN) * size**2:
        values = [float(f"{x:.4g}") for x in gravity]
        words = f"gravity points in another direction of the base frame: set robot.gravity = {values}"
        yield Alternative("gravity", words, state.but(gravity=gravity), 4.5, setup={"robot.gravity": values})


def _swapped(state: State) -> Alternative:
    return Alternative(
        "force_torque_swapped",
        "the first three columns of the wrench are the torque: give force, then torque",
        state.but(wrench=state.wrench[:, [3, 4, 5, 0, 1, 2]], unit=state.unit[::-1].copy(), swapped=not state.swapped),
        2,
    )


def _base_frame(state: State) -> Iterator[Alternative]:
    R = state.motion.rotation
    force, torque = state.wrench[:, :3], state.wrench[:, 3:]
    about_base = torque - np.cross(state.motion.position, force)
    mend = 'set log.wrench_axes = "base"'
    elsewhere = "record it about the sensor's origin"
    for words, moment, remedy, setup in (
        ("about the sensor", torque, mend, {"log.wrench_axes": "base"}),
        ("about the base's origin", about_base, elsewhere, {}),
    ):
        turned = np.concatenate([np.einsum("nji,nj->ni", R, x) for x in (force, moment)], 1)
        yield Alternative(
            "base_frame_wrench",
            f"the wrench has the axes of the base frame, its torque is {words}: {remedy}",
            state.but(wrench=turned),
            3.5,
            setup=setup,
        )
