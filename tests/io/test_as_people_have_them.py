"""The same log in many forms: other units, axes, conventions, separators, files. One result for all."""

import made_weights as made
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ftbias_jax.errors import LogError, SetupError
from ftbias_jax.io import read_log
from ftbias_jax.io.pose import STANDARD_GRAVITY
from ftbias_jax.io.stamps.clock import stamps_of
from ftbias_jax.setup import parse_setup
from ftbias_jax.setup.recorded import LogSetup
from ftbias_jax.setup.robots import built_in_robot

START = 1_708_857_503_931_759
"""Start of the log, microseconds since 1970."""
SAMPLES = 60
STEP = 2_003
"""Interval between samples in microseconds."""


def arm_setup(**log):
    return parse_setup({"robot": {"model": "ur5e"}, "sensor": {"noise_std": 0.1}, "log": log})


def pose_setup(log=(), **pose):
    stated = {"orientation": "quaternion_wxyz", "linear": "none", **pose}
    return parse_setup({"sensor_pose": stated, "sensor": {"noise_std": 0.1}, "log": dict(log)})


def arm():
    """Stamps in us, q, dq and wrench."""
    _, q, wrench = made.arm_log("ur5e", samples=SAMPLES)
    return START + STEP * np.arange(SAMPLES), q, np.gradient(q, axis=0), wrench


def pose():
    """Stamps in us, rotations, position, angular velocity, specific force and wrench, all of which vary."""
    t, q, _, wrench = arm()
    turned = Rotation.from_matrix(made.rotations(built_in_robot("ur5e"), q))
    rng = np.random.default_rng(1)
    return t, turned, *(np.cumsum(rng.normal(size=(SAMPLES, 3)), 0) for _ in range(3)), wrench


def wxyz(turned):
    return turned.as_quat()[:, [3, 0, 1, 2]]


def read(path, setup, **arrays):
    np.savez(path, **arrays)
    return read_log(path, setup, raw=True)


def assert_same(log, expected, start=True):
    for name in ("t", "q", "dq", "wrench"):
        np.testing.assert_allclose(getattr(log, name), getattr(expected, name), rtol=0, atol=1e-9, err_msg=name)
    assert not start or log.start == pytest.approx(expected.start, abs=1e-6)


@pytest.fixture
def npz(tmp_path):
    return tmp_path / "log.npz"


@pytest.fixture
def native(npz):
    t, q, dq, wrench = arm()
    return read(npz, arm_setup(), t=t * 1000, q=q, dq=dq, wrench=wrench)


@pytest.mark.parametrize(
    ("unit", "values"),
    [
        ("us", lambda t: t),
        ("us", lambda t: t.astype(float)),
        ("ns", lambda t: t * 1000),
        ("ms", lambda t: t / 1000),
        ("s", lambda t: t / 1e6),
    ],
)
def test_stamps_of_any_unit(npz, native, unit, values):
    t, q, dq, wrench = arm()
    log = read(npz, arm_setup(time_unit=unit), t=values(t), q=q, dq=dq, wrench=wrench)
    np.testing.assert_allclose(log.t, native.t, atol=1e-6)
    assert log.start == pytest.approx(native.start, abs=1e-5)


def test_whole_microseconds_lose_nothing():
    t = START + STEP * np.arange(SAMPLES)
    exact = stamps_of(t.astype(float), LogSetup(time_unit="us"))
    np.testing.assert_array_equal(exact, t * 1000)
    assert exact.dtype == np.int64


def test_a_rate_instead_of_stamps(npz, native):
    t, q, dq, wrench = arm()
    log = read(npz, arm_setup(rate=1e6 / STEP), q=q, dq=dq, wrench=wrench)
    assert_same(log, native, start=False)
    assert_same(read(npz, arm_setup(rate=1e6 / STEP), t=t * 0, q=q, dq=dq, wrench=wrench), native, start=False)


def test_joints_in_degrees(npz, native):
    t, q, dq, wrench = arm()
    log = read(npz, arm_setup(angle_unit="deg"), t=t * 1000, q=np.degrees(q), dq=np.degrees(dq), wrench=wrench)
    assert_same(log, native)


def test_joints_that_slide_stay_in_metres(npz):
    joints = [{"axis": [0, 0, 1], "type": "prismatic"}, {"axis": [0, 1, 0], "point": [0, 0, 1]}]
    robot = {"joints": joints, "flange": {"translation": [0, 0, 1]}}
    setup = parse_setup({"robot": robot, "sensor": {"noise_std": 0.1}, "log": {"angle_unit": "deg"}})
    t = np.arange(50) / 100
    q = np.random.default_rng(0).normal(size=(50, 2))
    log = read(npz, setup, t=t, q=q, wrench=np.random.default_rng(1).normal(size=(50, 6)))
    np.testing.assert_allclose(log.q, q * [1, np.pi / 180])


@pytest.fixture
def posed(npz):
    t, turned, position, rate, force, wrench = pose()
    arrays = {"orientation": wxyz(turned), "position": position, "angular_velocity": rate, "specific_force": force}
    logs = {}
    for linear in ("position", "specific_force", "none"):
        logs[linear] = read(npz, pose_setup(linear=linear), t=t * 1000, wrench=wrench, **arrays)
    return logs


@pytest.mark.parametrize(
    ("stated", "recorded"),
    [
        ({"conjugate": True}, lambda r: wxyz(r.inv())),
        ({"orientation": "quaternion_xyzw"}, lambda r: r.as_quat()),
        ({"orientation": "quaternion_xyzw", "conjugate": True}, lambda r: r.inv().as_quat()),
        ({"orientation": "matrix", "conjugate": True}, lambda r: r.as_matrix().transpose(0, 2, 1)),
        ({"orientation": "axis_angle"}, lambda r: r.as_rotvec()),
        ({"orientation": "axis_angle", "conjugate": True}, lambda r: -r.as_rotvec()),
        ({"orientation": "rpy"}, lambda r: r.as_euler("xyz")),
        ({"orientation": "rpy", "conjugate": True}, lambda r: r.inv().as_euler("ZYX")[:, ::-1]),
    ],
)
def test_orientations_as_they_are_recorded(npz, posed, stated, recorded):
    t, turned, position, _, _, wrench = pose()
    arrays = {"t": t * 1000, "orientation": recorded(turned), "position": position, "wrench": wrench}
    log = read(npz, pose_setup(linear="position", **stated), **arrays)
    expected = posed["position"]
    sign = np.sign(log.q[:1, :4] @ expected.q[:1, :4].T)
    np.testing.assert_allclose(sign * log.q[:, :4], expected.q[:, :4], atol=1e-9)
    np.testing.assert_allclose(log.q[:, 4:], expected.q[:, 4:], atol=1e-9)


def test_degrees_of_an_axis_angle_and_a_gyroscope(npz, posed):
    t, turned, _, rate, _, wrench = pose()
    arrays = {"orientation": np.degrees(turned.as_rotvec()), "angular_velocity": np.degrees(rate), "wrench": wrench}
    log = read(npz, pose_setup({"angle_unit": "deg"}, orientation="axis_angle"), t=t * 1000, **arrays)
    sign = np.sign(log.q[:1] @ posed["none"].q[:1].T)
    np.testing.assert_allclose(sign * log.q, posed["none"].q, atol=1e-9)
    np.testing.assert_allclose(sign * log.dq, posed["none"].dq, atol=1e-9)


def test_a_position_in_the_bodys_axes(npz, posed):
    t, turned, position, rate, _, wrench = pose()
    arrays = {"orientation": wxyz(turned), "position": turned.inv().apply(position), "angular_velocity": rate}
    log = read(npz, pose_setup(linear="position", position_axes="body"), t=t * 1000, wrench=wrench, **arrays)
    assert_same(log, posed["position"])


def test_an_imu_in_g_in_axes_of_its_own(npz, posed):
    t, turned, _, rate, force, wrench = pose()
    rpy = [0.4, -0.3, 2.0]
    imu = Rotation.from_euler("xyz", rpy)  # of the IMU in the sensor
    arrays = {
        "orientation": wxyz(turned),
        "angular_velocity": imu.inv().apply(rate),
        "specific_force": imu.inv().apply(force) / STANDARD_GRAVITY,
    }
    setup = pose_setup({"acceleration_unit": "g"}, linear="specific_force", imu_rotation_rpy=rpy)
    assert_same(read(npz, setup, t=t * 1000, wrench=wrench, **arrays), posed["specific_force"])


@pytest.mark.parametrize("recorded", [True, False])
def test_an_imu_without_a_gyroscope(npz, posed, recorded):
    t, turned, _, rate, force, wrench = pose()
    arrays = {"orientation": wxyz(turned), "specific_force": force, "wrench": wrench}
    if recorded:
        arrays["angular_velocity"] = 57 * rate
    setup = pose_setup(linear="specific_force", gyroscope=not recorded)
    log = read(npz, setup, t=t * 1000, **arrays)
    assert np.isnan(log.dq[:, :4]).all()
    np.testing.assert_allclose(log.dq[:, 4:], posed["specific_force"].dq[:, 4:])
    np.testing.assert_allclose(log.q[:, :4], posed["specific_force"].q[:, :4])


def test_a_gyroscope_can_be_left_out_where_nothing_else_is_recorded(npz, posed):
    t, turned, _, rate, _, wrench = pose()
    arrays = {"orientation": wxyz(turned), "angular_velocity": rate, "wrench": wrench}
    log = read(npz, pose_setup(gyroscope=False), t=t * 1000, **arrays)
    assert np.isnan(log.dq).all()
    np.testing.assert_allclose(log.q, posed["none"].q)


NAMES = ["t", *(f"q{i}" for i in range(1, 7)), *(f"dq{i}" for i in range(1, 7)), "fx", "fy", "fz", "tx", "ty", "tz"]


@pytest.mark.parametrize(
    ("separator", "change"),
    [
        (",", lambda cell: cell),
        (";", lambda cell: cell),
        (";", lambda cell: cell.replace(".", ",")),
        ("\t", lambda cell: cell),
        (" ", lambda cell: cell),
        ("   ", lambda cell: cell),
    ],
)
@pytest.mark.parametrize("mark", ["", "# "])
def test_tables_with_any_separator(tmp_path, native, separator, change, mark):
    t, q, dq, wrench = arm()
    rows = [[str(time), *map(repr, map(float, row))] for time, row in zip(t, np.hstack([q, dq, wrench]), strict=True)]
    lines = [separator.join(change(cell) for cell in row) for row in rows]
    path = tmp_path / "log.csv"
    path.write_text("\n".join([mark + separator.join(NAMES), *lines]) + "\n")
    assert_same(read_log(path, arm_setup(time_unit="us"), raw=True), native)


FILES = {"position": "*_qw.csv", "velocity": "*_ax.csv", "wrench": "*_fx.csv"}


def test_a_log_that_is_none_of_the_files_is_refused(tmp_path):
    setup = pose_setup({"files": FILES})
    with pytest.raises(LogError, match=r"fits one of \*_qw.csv, \*_ax.csv, \*_fx.csv"):
        read_log(tmp_path / "log.npz", setup)
    with pytest.raises(LogError, match=r"1_qw.csv: cannot be read"):
        read_log(tmp_path / "1_fx.csv", setup)
    with pytest.raises(SetupError, match="name the files of position and wrench"):
        pose_setup({"files": {"wrench": "*.csv"}})
