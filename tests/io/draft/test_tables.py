"""Tables and arrays without any description: the draft detects how they were recorded, and weighs the tool."""

import log_files
import made_weights as made
import numpy as np
import pytest
import recordings
from scipy.spatial.transform import Rotation

from ftbias_jax.errors import LogError, UsageError
from ftbias_jax.io import read_log
from ftbias_jax.io.draft.draft import Request, draft
from ftbias_jax.io.draft.rows import time_unit
from ftbias_jax.io.draft.table import look, patterns
from ftbias_jax.io.info import describe
from ftbias_jax.io.pose import STANDARD_GRAVITY
from ftbias_jax.setup import load_setup
from ftbias_jax.setup.robots import built_in_robot
from ftbias_jax.types import AXES

RATE, SAMPLES = 100, 2000
T = np.arange(SAMPLES) / RATE
EPOCH = 1_708_857_503_931_759


def motion():
    """Rotations, position, angular velocity in the body, and acceleration: 20 s of swinging about all axes."""
    robot = built_in_robot("ur5e")
    q = 0.8 * np.sin(0.7 * T[:, None] + np.arange(6)) - 0.3
    turned = made.rotations(robot, q)
    position = 0.3 * np.stack([np.sin(2.1 * T), np.cos(1.7 * T), np.sin(1.3 * T)], 1)
    acceleration = np.gradient(np.gradient(position, T, axis=0), T, axis=0)
    rate = Rotation.from_matrix(turned[:-1].transpose(0, 2, 1) @ turned[1:]).as_rotvec() * RATE
    return turned, position, np.vstack([rate, rate[-1:]]), acceleration


def wrench_of(turned, acceleration=0.0, sign=1.0):
    force = made.MASS * np.einsum("tji,tj->ti", turned, acceleration - made.GRAVITY + 0 * turned[:, 0])
    noise = np.random.default_rng(0).normal(size=(len(force), 6)) * np.repeat([0.05, 0.002], 3)
    return sign * np.hstack([force, np.cross(made.CENTER, force)]) - made.BIAS + noise


def drafted(tmp_path, *logs, **more):
    found = draft(Request(logs=[str(log) for log in logs], output=str(tmp_path / "setup.toml"), **more))
    (tmp_path / "setup.toml").write_text(found.text)
    return load_setup(tmp_path / "setup.toml")


def assert_weighed(setup):
    assert abs(setup.tool.mass - made.MASS) < 0.05
    np.testing.assert_allclose(setup.tool.center_of_mass, made.CENTER, atol=4e-3)


ORIENTATIONS = {
    ("quaternion_xyzw", False): lambda r: r.as_quat(),
    ("quaternion_wxyz", False): lambda r: r.as_quat()[:, [3, 0, 1, 2]],
    ("quaternion_xyzw", True): lambda r: r.inv().as_quat(),
    ("quaternion_wxyz", True): lambda r: r.inv().as_quat()[:, [3, 0, 1, 2]],
    ("matrix", False): lambda r: r.as_matrix(),
    ("matrix", True): lambda r: r.inv().as_matrix(),
    ("axis_angle", False): lambda r: r.as_rotvec(),
    ("rpy", False): lambda r: r.as_euler("xyz"),
}


@pytest.mark.parametrize("apart", [None, 12.0])
def test_static_poses_are_read_weighed_and_told_as_such(tmp_path, apart):
    """A quaternion in the other order, forces in base axes; 12 s might be 12 ms, but no arm turns that fast."""
    turned = Rotation.random(30, np.random.default_rng(3))
    inside = wrench_of(turned.as_matrix(), sign=-1.0)
    wrench = np.hstack([turned.apply(inside[:, part]) for part in (slice(0, 3), slice(3, 6))])
    arrays = {"orientation": turned.as_quat()[:, [3, 0, 1, 2]], "wrench": wrench, "specific_force": wrench[:, :3]}
    log_files.write(path := tmp_path / "poses.npz", arrays | ({} if apart is None else {"t": apart * np.arange(30)}))
    assert "each row as of a pose at rest" in describe(path).verdict
    setup = drafted(tmp_path, path)
    assert (setup.pose.orientation, setup.log.wrench_axes) == ("quaternion_wxyz", "base")
    assert setup.sensor.reports == "wrench_on_sensor"
    assert (setup.log.time_unit, setup.log.rate) == (None, None)
    assert_weighed(setup)
    info = describe(path, setup)
    assert info.poses
    assert np.isnan(info.streams[0].rate) == (apart is None)


@pytest.mark.parametrize(("order", "conjugate"), ORIENTATIONS)
def test_the_convention_of_an_orientation_is_the_one_that_gravity_fits(tmp_path, order, conjugate):
    turned, *_ = motion()
    recorded = ORIENTATIONS[order, conjugate](Rotation.from_matrix(turned))
    np.savez(tmp_path / "log.npz", t=T, orientation=recorded, wrench=wrench_of(turned))
    setup = drafted(tmp_path, tmp_path / "log.npz")
    assert (setup.pose.orientation, setup.pose.conjugate) == (order, conjugate)
    assert setup.pose.linear == "none"
    assert_weighed(setup)


def test_a_wrench_in_base_axes_of_the_opposite_sign(tmp_path):
    turned, *_ = motion()
    sensor = wrench_of(turned, sign=-1.0)
    base = np.hstack([np.einsum("tij,tj->ti", turned, part) for part in (sensor[:, :3], sensor[:, 3:])])
    orientation = Rotation.from_matrix(turned).as_quat()
    np.savez(tmp_path / "log.npz", t=T, orientation=orientation, wrench=base)
    setup = drafted(tmp_path, tmp_path / "log.npz")
    assert setup.log.wrench_axes == "base"
    assert setup.sensor.reports == "wrench_on_sensor"
    assert_weighed(setup)


@pytest.mark.parametrize("axes", ["base", "body"])
def test_the_axes_of_a_position_are_those_whose_acceleration_the_forces_show(tmp_path, axes):
    turned, position, _, acceleration = motion()
    recorded = position if axes == "base" else np.einsum("tji,tj->ti", turned, position)
    arrays = {"orientation": Rotation.from_matrix(turned).as_quat(), "position": recorded}
    np.savez(tmp_path / "log.npz", t=T, wrench=wrench_of(turned, acceleration), **arrays)
    setup = drafted(tmp_path, tmp_path / "log.npz")
    assert (setup.pose.linear, setup.pose.position_axes) == ("position", axes)


ROBOTS = {
    "kuka": ("X Y Z A B C", "rpy", "mm", "deg", lambda r: np.degrees(r.as_euler("ZYX"))),
    "rsi": (
        "RIst.X RIst.Y RIst.Z RIst.A RIst.B RIst.C",
        *("rpy", "mm", "deg"),
        lambda r: np.degrees(r.as_euler("ZYX")),
    ),
    "egm": ("x y z u0 u1 u2 u3", "quaternion_xyzw", "mm", "rad", lambda r: r.as_quat()[:, [3, 0, 1, 2]]),
    "fanuc": ("x y z w p r", "rpy", "mm", "deg", lambda r: np.degrees(r.as_euler("xyz"))),
    "doosan": (
        "x[mm] y[mm] z[mm] rx[deg] ry[deg] rz[deg]",
        "rpy",
        "mm",
        "deg",
        lambda r: np.degrees(r.as_euler("xyz")),
    ),
    "ur": (" ".join(f"actual_TCP_pose_{i}" for i in range(6)), "axis_angle", "m", "rad", lambda r: r.as_rotvec()),
    "axis_angle": ("x y z rx ry rz", "axis_angle", "m", "deg", lambda r: np.degrees(r.as_rotvec())),
    "abb": ("x y z q1 q2 q3 q4", "quaternion_xyzw", "mm", "rad", lambda r: r.as_quat()[:, [3, 0, 1, 2]]),
}


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_pose_is_recognised_by_the_columns_of_its_controller(tmp_path, robot):
    """Without a unit in the names, mm and degrees show by their size, and rx ry rz by the weight."""
    turned, position, _, acceleration = motion()
    names, order, length, angle, recorded = ROBOTS[robot]
    values = [position * (1e3 if length == "mm" else 1.0), recorded(Rotation.from_matrix(turned))]
    columns = [*names.split(), *AXES]
    log = write(tmp_path / "log.csv", columns, T, np.hstack([*values, wrench_of(turned, acceleration)]))
    setup = drafted(tmp_path, log)
    assert (setup.pose.orientation, setup.pose.linear) == (order, "position")
    assert (setup.log.length_unit, setup.log.angle_unit) == (length, angle)
    assert_weighed(setup)
    np.testing.assert_allclose(read_log(log, setup).q[:, 4:], position, atol=1e-9)


def test_four_of_six_joints_are_no_quaternion(tmp_path):
    t, q, wrench = made.arm_log("ur5e")
    log = write(tmp_path / "log.csv", [*(f"q{i}" for i in range(1, 7)), *AXES], t, np.hstack([q, wrench]))
    assert look(str(log)).orientation == ""


@pytest.mark.parametrize(
    ("factor", "used", "unit"), [(1.0, True, "rad"), (180 / np.pi, True, "deg"), (0.01745, False, "rad")]
)
def test_a_gyroscope_is_compared_with_the_orientation(tmp_path, factor, used, unit):
    turned, _, rate, _ = motion()
    arrays = {"orientation": Rotation.from_matrix(turned).as_quat(), "angular_velocity": factor * rate}
    np.savez(tmp_path / "log.npz", t=T, wrench=wrench_of(turned), **arrays)
    setup = drafted(tmp_path, tmp_path / "log.npz")
    assert (setup.pose.gyroscope, setup.log.angle_unit) == (used, unit)


def write(path, names, t, values):
    np.savetxt(path, np.column_stack([t, values]), "%.17g", ",", header=",".join(["t", *names]), comments="")
    return path


def three_files(folder):
    turned, _, _, acceleration = motion()
    t = EPOCH + (T * 1e6).astype(np.int64)
    imu = Rotation.from_euler("xyz", [0.3, 1.2, -2.0])
    felt = imu.inv().apply(np.einsum("tji,tj->ti", turned, acceleration - made.GRAVITY)) / STANDARD_GRAVITY
    names = {"wrench": ["fx", "fy", "fz", "tx", "ty", "tz"], "accel": ["ax", "ay", "az"]}
    names["orientations"] = [f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)]
    values = {"wrench": wrench_of(turned), "accel": felt, "orientations": turned.reshape(-1, 9)}
    late = {"wrench": 300, "accel": 700, "orientations": 0}
    return [write(folder / f"1-{name}.csv", names[name], t + late[name], values[name]) for name in names], imu


def test_three_files_in_microseconds_and_g(tmp_path):
    files, imu = three_files(tmp_path)
    setup = drafted(tmp_path, *files)
    assert setup.log.files == {"position": "*orientations.csv", "velocity": "*accel.csv", "wrench": "*wrench.csv"}
    assert (setup.log.time_unit, setup.log.acceleration_unit) == ("us", "g")
    assert (setup.pose.orientation, setup.pose.linear, setup.pose.gyroscope) == ("matrix", "specific_force", False)
    off = Rotation.from_matrix(setup.pose.imu_rotation.T @ imu.as_matrix()).magnitude()
    assert off < 0.05
    assert_weighed(setup)
    log = read_log(files[0], setup)
    assert len(log.t) == 3 * SAMPLES
    assert log.start == pytest.approx(EPOCH * 1e-6, abs=1e-3)


def test_joints_in_degrees_are_beyond_their_limits(tmp_path):
    t, q, wrench = made.arm_log("ur5e")
    names = [*(f"q{i}" for i in range(6)), "fx", "fy", "fz", "tx", "ty", "tz"]
    write(tmp_path / "log.csv", names, t, np.hstack([np.degrees(q), wrench]))
    setup = drafted(tmp_path, tmp_path / "log.csv", robot="ur5e")
    assert setup.log.angle_unit == "deg"
    assert_weighed(setup)


def test_rows_without_stamps_need_a_rate(tmp_path):
    turned, *_ = motion()
    orientation = Rotation.from_matrix(turned).as_quat()
    np.savez(tmp_path / "log.npz", orientation=orientation, wrench=wrench_of(turned))
    with pytest.raises(LogError, match="there is no time"):
        drafted(tmp_path, tmp_path / "log.npz")
    setup = drafted(tmp_path, tmp_path / "log.npz", rate=float(RATE))
    assert setup.log.rate == RATE
    assert_weighed(setup)


@pytest.mark.parametrize(
    ("t", "unit"),
    [
        (T, ""),
        (T * 1e3, "ms"),
        (T * 1e6, "us"),
        (EPOCH * 1e-6 + T, ""),
        (EPOCH + (T * 1e6).astype(int), "us"),
        (EPOCH * 1000 + (T * 1e9).astype(int), ""),
        ((EPOCH // 1000 + T * 1e3).astype(int), "ms"),
    ],
)
def test_the_unit_of_stamps_is_a_plausible_one(t, unit):
    assert time_unit(t) == unit


def test_files_that_do_not_go_together_are_refused(tmp_path):
    files, _ = three_files(tmp_path)
    with pytest.raises(LogError, match="has wrench too"):
        patterns([look(str(files[0])), look(str(files[0]))._replace(path="2-wrench.csv")])
    write(tmp_path / "1-other.csv", ["x1"], T, T)
    with pytest.raises(LogError, match="has neither joints, pose, wrench nor an IMU"):
        patterns([look(str(files[0])), look(str(tmp_path / "1-other.csv"))])
    with pytest.raises(LogError, match="No such file"):
        look(str(tmp_path / "none.csv"))
    with pytest.raises(UsageError, match="which robot is it"):
        drafted(tmp_path, files[0])


def test_joints_in_a_bag_and_a_wrench_in_a_table(tmp_path):
    robot = built_in_robot("ur5e")
    t, q, wrench = made.arm_log("ur5e")
    ns = recordings.START + (t * 1e9).astype(np.int64)
    joints = [recordings.Joints(int(at), robot.joint_names, tuple(x)) for at, x in zip(ns, q, strict=True)]
    recordings.write(tmp_path, "ros1", joints).rename(tmp_path / "run1.bag")
    names = ["fx", "fy", "fz", "tx", "ty", "tz"]
    table = write(tmp_path / "run1_ft.csv", names, ns // 1000, wrench)
    setup = drafted(tmp_path, table, tmp_path / "run1.bag", robot="ur5e")
    assert setup.log.files == {"position": "*.bag", "wrench": "*_ft.csv"}
    assert (setup.log.time_unit, setup.log.time_units) == ("us", {})
    assert_weighed(setup)
    assert len(read_log(tmp_path / "run1.bag", setup).t) > 400


def test_two_tables_with_different_units_of_time(tmp_path):
    t, q, wrench = made.arm_log("ur5e")
    np.savez(tmp_path / "1_joints.npz", t=EPOCH * 1e-6 + t, q=q)
    table = write(tmp_path / "1_ft.csv", ["fx", "fy", "fz", "tx", "ty", "tz"], EPOCH * 1e-3 + t * 1e3, wrench)
    setup = drafted(tmp_path, tmp_path / "1_joints.npz", table, robot="ur5e")
    assert setup.log.time_units == {"position": "s", "wrench": "ms"}
    assert_weighed(setup)


MOUNTS = {"turned over": (0, 0, 180.0), "odd": (150.0, 20.0, -100.0), "small": (5.0, 0, 0)}


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("robot", ["kuka", "doosan", "axis_angle"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_tool_frame_that_is_turned_against_the_sensor_is_no_other_convention(tmp_path, mount, robot, sign):
    """The tool points down and tilts by 40 degrees, so that the bias explains most of the weight along it."""
    tilts = np.radians(40) * np.stack([np.sin(0.7 * T), np.sin(0.9 * T + 1), np.sin(0.5 * T + 2)], 1)
    sensor = Rotation.from_euler("x", 180, degrees=True) * Rotation.from_rotvec(tilts)
    recorded = sensor * Rotation.from_euler("xyz", MOUNTS[mount], degrees=True).inv()
    names, order, _, angle, in_numbers = ROBOTS[robot]
    values = [np.zeros((SAMPLES, 3)), in_numbers(recorded), wrench_of(sensor.as_matrix(), sign=sign)]
    log = write(tmp_path / "log.csv", [*names.split(), *AXES], T, np.hstack(values))
    setup = drafted(tmp_path, log)
    assert (setup.pose.orientation, setup.log.angle_unit, setup.pose.conjugate) == (order, angle, False)
    assert setup.log.wrench_axes == "sensor"
    assert setup.sensor.reports == ("wrench_on_tool" if sign > 0 else "wrench_on_sensor")
    assert setup.tool.mass == pytest.approx(made.MASS, rel=0.02)
