"""Common mistakes, each of which changes the tables of a right setup or the arrays of a log."""

import copy
from itertools import permutations, product

import numpy as np

import ftbias_jax as ft
from ftbias_jax.check.motion import arm_motion, data_matrices
from ftbias_jax.check.regression import stated_tool

G, LBF = 9.80665, 4.4482216


def scaled(*factors):
    """Return a mistake: force and torque in other units, by these factors."""

    def change(tables, arrays, rng):
        arrays["wrench"] = arrays["wrench"] * np.repeat(factors, 3)

    return change


def setting(section, key, value):
    """Return a mistake: a wrong value in the setup, given directly or as a function of the right value."""

    def change(tables, arrays, rng):
        values = tables.setdefault(section, {})
        values[key] = value(values.get(key)) if callable(value) else value

    return change


def both(*changes):
    def change(tables, arrays, rng):
        for one in changes:
            one(tables, arrays, rng)

    return change


def sign(tables, arrays, rng):
    other = {"wrench_on_tool": "wrench_on_sensor", "wrench_on_sensor": "wrench_on_tool"}
    tables["sensor"]["reports"] = other[tables["sensor"].get("reports", "wrench_on_tool")]


def degrees(tables, arrays, rng):
    turning = [joint.get("type") != "prismatic" for joint in tables["robot"].get("joints", [{}] * arrays["q"].shape[1])]
    for name in ("q", "dq"):
        if name in arrays:
            arrays[name] = arrays[name] * np.where(turning, 180 / np.pi, 1)


def swapped(tables, arrays, rng):
    arrays["wrench"] = arrays["wrench"][:, [3, 4, 5, 0, 1, 2]]


def turned(matrix):
    """Return a mistake: a sensor that is mounted differently, or whose columns are permuted or mirrored."""

    def change(tables, arrays, rng):
        P = matrix(rng) if callable(matrix) else np.array(matrix, float)
        arrays["wrench"] = np.concatenate([arrays["wrench"][:, :3] @ P.T, arrays["wrench"][:, 3:] @ P.T], 1)

    return change


def _signed_permutation(rng, determinant):
    orders = product(permutations(range(3)), product((1, -1), repeat=3))
    every = [np.eye(3)[list(order)] * signs for order, signs in orders]
    every = [P for P in every if np.sign(np.linalg.det(P)) == determinant and abs(np.trace(P)) != 3]
    return every[rng.integers(len(every))]


def tool_wrench(tables, arrays, gravity=True):
    """Return the wrench of the tool along the log, with the sign of the reading, and the motion of the sensor."""
    setup = ft.parse_setup(tables)
    log = ft.Log.from_arrays(setup, **arrays)
    dt = log.t
    dq = log.dq if np.isfinite(log.dq).all() else np.gradient(log.q, dt, axis=0)
    width = max(3, int(0.1 / np.median(np.diff(dt))))
    smooth = np.stack([np.convolve(x, np.ones(width) / width, "same") for x in dq.T], 1)
    motion = arm_motion(setup.robot, setup.sensor, log.q, dq, np.gradient(smooth, dt, axis=0))
    D = data_matrices(motion, setup.robot.gravity)
    if not gravity:
        D = D - data_matrices(motion, np.zeros(3))
    flip = 1.0 if setup.sensor.reports == "wrench_on_tool" else -1.0
    return flip * (D @ stated_tool(setup.tool).theta), motion


def without_tool(tables, arrays, rng):
    arrays["wrench"] = arrays["wrench"] - tool_wrench(tables, arrays)[0]


def without_weight(tables, arrays, rng):
    arrays["wrench"] = arrays["wrench"] - tool_wrench(tables, arrays, gravity=False)[0]


def _first(arrays, count=20):
    return np.nanmean(arrays["wrench"][np.flatnonzero(np.isfinite(arrays["wrench"]).all(1))[:count]], 0)


def zeroed_at_start(tables, arrays, rng):
    """Tare the sensor at the first sample."""
    arrays["wrench"] = arrays["wrench"] - _first(arrays, 1)


def tared_while_recording(tables, arrays, rng):
    rows = np.flatnonzero(np.isfinite(arrays["wrench"]).all(1))
    for share in np.sort(rng.uniform(0.2, 0.8, 2)):
        at = rows[int(share * len(rows))]
        wrench = arrays["wrench"].copy()
        wrench[at:] -= wrench[at]
        arrays["wrench"] = wrench


def late(tables, arrays, rng):
    """Shift the stamps of the wrench by 0.3 to 2 s, late or early."""
    delay = rng.uniform(0.3, 2.0) * rng.choice([-1, 1])
    t = arrays["t"]
    step = round(delay / np.median(np.diff(t)))
    arrays["wrench"] = np.roll(arrays["wrench"], step, 0)
    arrays["wrench"][: max(step, 0)] = np.nan
    if step < 0:
        arrays["wrench"][step:] = np.nan


def in_base_frame(tables, arrays, rng):
    _, motion = tool_wrench(tables, arrays)
    turn = motion.rotation
    arrays["wrench"] = np.concatenate(
        [np.einsum("nij,nj->ni", turn, arrays["wrench"][:, part]) for part in (slice(0, 3), slice(3, 6))], 1
    )


def offset(tables, arrays, rng):
    arrays["wrench"] = arrays["wrench"] + np.repeat([rng.choice([-12800.0, 300.0, -1000.0]), 8.0], 3)


def odd_mount(tables, arrays, rng):
    """Rotate the sensor by an arbitrary axis and angle, which is no common mounting."""
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    angle = rng.uniform(2.0, 2.6)
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turned(np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K)(tables, arrays, rng)


def rpy_in_degrees(tables, arrays, rng):
    """State the roll, pitch and yaw of a rotated sensor in degrees."""
    tables["sensor"]["rotation_rpy"] = np.degrees(tables["sensor"]["rotation_rpy"]).tolist()


def _turning(tables, arrays):
    """Mask of the revolute joints."""
    joints = tables["robot"].get("joints", [{}] * arrays["q"].shape[1])
    return np.array([joint.get("type") != "prismatic" for joint in joints])


def _one_of(tables, arrays, rng):
    """Mask of a random revolute joint: not the first, which may be vertical, nor the last, which turns the sensor."""
    joint = rng.choice(np.flatnonzero(_turning(tables, arrays)[:-1])[1:])
    return np.arange(arrays["q"].shape[1]) == joint


def _with_joints(arrays, change):
    arrays.update({name: change(arrays[name]) for name in ("q", "dq") if name in arrays})


def joints_exchanged(tables, arrays, rng):
    count = arrays["q"].shape[1]
    order, pair = np.arange(count), rng.choice(np.arange(1, count - 1), 2, replace=False)
    order[pair] = pair[::-1]
    _with_joints(arrays, lambda x: x[:, order])


def one_channel_negated(tables, arrays, rng):
    arrays["wrench"] = arrays["wrench"] * np.where(np.arange(6) == rng.integers(6), -1, 1)


def one_joint_in_degrees(tables, arrays, rng):
    factors = np.where(_one_of(tables, arrays, rng), 180 / np.pi, 1)
    _with_joints(arrays, lambda x: x * factors)


def joint_turned_round(tables, arrays, rng):
    signs = np.where(_one_of(tables, arrays, rng), -1, 1)
    _with_joints(arrays, lambda x: x * signs)


def joint_from_another_zero(tables, arrays, rng):
    ahead = rng.choice([np.pi / 2, np.pi, -np.pi / 2])
    arrays["q"] = arrays["q"] + ahead * _one_of(tables, arrays, rng)


MISTAKES = {
    "sign": ("sign", sign),
    "gravity up": ("gravity", setting("robot", "gravity", [0.0, 0.0, 9.81])),
    "gravity along x": ("gravity", setting("robot", "gravity", [9.81, 0.0, 0.0])),
    "wrench in kgf": ("wrench_units", scaled(1 / G, 1 / G)),
    "wrench in lbf": ("wrench_units", scaled(1 / LBF, 1 / LBF)),
    "wrench in gram-force": ("wrench_units", scaled(1e3 / G, 1e3 / G)),
    "wrench in mN": ("wrench_units", scaled(1e3, 1e3)),
    "torque in Nmm": ("wrench_units", scaled(1, 1e3)),
    "mass in g": ("tool_units", setting("tool", "mass", lambda x: 1e3 * x)),
    "lengths in mm": ("tool_units", setting("tool", "center_of_mass", lambda x: [1e3 * v for v in x])),
    "mass in g, lengths in mm": (
        "tool_units",
        both(
            setting("tool", "mass", lambda x: 1e3 * x),
            setting("tool", "center_of_mass", lambda x: [1e3 * v for v in x]),
        ),
    ),
    "q in degrees": ("angle_units", degrees),
    "one joint in degrees": ("angle_units", one_joint_in_degrees),
    "one channel negated": ("sign", one_channel_negated),
    "rpy in degrees": ("angle_units", rpy_in_degrees),
    "force and torque swapped": ("force_torque_swapped", swapped),
    "sensor turned 180 deg": ("sensor_axes", turned(np.diag([-1, -1, 1]))),
    "sensor turned 90 deg": ("sensor_axes", turned([[0, -1, 0], [1, 0, 0], [0, 0, 1]])),
    "sensor upside down": ("sensor_axes", turned(np.diag([1, -1, -1]))),
    "axes permuted": ("sensor_axes", turned(lambda rng: _signed_permutation(rng, 1))),
    "axes mirrored": ("sensor_axes", turned(lambda rng: _signed_permutation(rng, -1))),
    "payload compensated": ("compensated", without_tool),
    "weight compensated": ("compensated", without_weight),
    "zeroed at the start": ("rezeroed", zeroed_at_start),
    "zeroed on the way": ("rezeroed", tared_while_recording),
    "clocks off by 0.3 to 2 s": ("time_offset", late),
    "wrench in the base frame": ("base_frame_wrench", in_base_frame),
    "raw offset": ("raw_offset", offset),
    "sensor turned by an odd angle": ("sensor_axes", odd_mount),
    "tool 2.6 times too heavy": ("worse_than_raw", setting("tool", "mass", lambda x: 2.6 * x)),
    "two joints exchanged": ("joint_convention", joints_exchanged),
    "a joint turned round": ("joint_convention", joint_turned_round),
    "a joint from another zero": ("joint_convention", joint_from_another_zero),
    "gravity up, sensor turned by an odd angle": (
        "sensor_axes",
        both(setting("robot", "gravity", [0.0, 0.0, 9.81]), odd_mount),
    ),
}
"""Name -> (expected finding, mistake)."""


def reordered(tables, arrays, rng):
    arrays["orientation"] = arrays["orientation"][:, [3, 0, 1, 2]]


def conjugate(tables, arrays, rng):
    arrays["orientation"] = arrays["orientation"] * [-1, -1, -1, 1]


def in_body(tables, arrays, rng):
    x, y, z, w = arrays["orientation"].T
    v = np.stack([-x, -y, -z], 1)
    p = arrays["position"]
    twice = 2 * np.cross(v, p)
    arrays["position"] = p + w[:, None] * twice + np.cross(v, twice)


def gyroscope_in_degrees(tables, arrays, rng):
    arrays["angular_velocity"] = np.degrees(arrays["angular_velocity"])


POSE_MISTAKES = {
    "quaternion in the other order": ("quaternion_convention", reordered),
    "conjugate quaternion": ("quaternion_convention", conjugate),
    "position in the body's axes": ("position_frame", in_body),
    "gyroscope in deg/s": ("gyroscope_units", gyroscope_in_degrees),
    "pose: sign": ("sign", sign),
    "pose: sensor turned 180 deg": ("sensor_axes", turned(np.diag([-1, -1, 1]))),
}
"""Name -> (expected finding, mistake) for recorded poses."""


def mistaken(change, tables, arrays, rng):
    """Return copies of tables and arrays with one mistake."""
    tables, arrays = copy.deepcopy(tables), dict(arrays)
    change(tables, arrays, rng)
    return tables, arrays


def applies(name, tables, arrays):
    """Whether a mistake in a recorded pose can be made with this log."""
    needs = {"position in the body's axes": "position", "gyroscope in deg/s": "angular_velocity"}
    if needs.get(name, "wrench") not in arrays:
        return False
    return arrays["orientation"].ndim == 2 or not name.startswith(("quaternion", "conjugate"))
