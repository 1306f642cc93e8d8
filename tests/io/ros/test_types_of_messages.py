"""Logs from messages other than JointState and WrenchStamped: by their types, and by fields that the setup names."""

import numpy as np
import pytest
import recordings
from recordings import SECOND, START, Joints, Other, Wrench

from ftbias_jax.errors import LogError, SetupError
from ftbias_jax.io import read_log
from ftbias_jax.setup import parse_setup

COUNT = 60
FRANKA = {
    "ros1": ("franka_msgs/msg/FrankaState", "std_msgs/Header header\nfloat64[6] K_F_ext_hat_K\nfloat64[7] q\n"
             "float64[7] dq\nfloat64[6] O_F_ext_hat_K\nfranka_msgs/Errors current_errors"),
    "mcap": ("franka_msgs/msg/FrankaRobotState", "std_msgs/Header header\nErrors current_errors\n"
             "sensor_msgs/JointState measured_joint_state\nfloat64[7] dtau_j\n"
             "geometry_msgs/WrenchStamped k_f_ext_hat_k"),
}  # fmt: skip
ERRORS = {"franka_msgs/msg/Errors": "bool joint_velocity_violation\nbool other"}


def random_log(joints=2):
    rng = np.random.default_rng(3)
    t = START + np.arange(COUNT) * SECOND // 100
    return t, rng.normal(size=(COUNT, joints)), rng.normal(size=(COUNT, joints)), rng.normal(size=(COUNT, 6))


def published(*streams):
    return sorted((message for stream in streams for message in stream), key=lambda m: m.logged or m.stamp)


def arm(t, q, dq):
    return [Joints(int(s), ("base", "elbow"), tuple(a), tuple(b)) for s, a, b in zip(t, q, dq, strict=True)]


def wrenches(t, values):
    return [Wrench(int(s), tuple(w)) for s, w in zip(t, values, strict=True)]


def measured(values):
    return values[~np.isnan(values).any(1)]


@pytest.mark.parametrize("kind", ["ros1", "sqlite", "mcap"])
def test_a_wrench_without_a_header_has_the_recorder_s_times(tmp_path, make_setup, kind):
    t, q, dq, w = random_log()
    bare = [
        Other(int(s), "geometry_msgs/msg/Wrench", {"force": tuple(x[:3]), "torque": tuple(x[3:])}, "/ft", int(s) + 7)
        for s, x in zip(t, w, strict=True)
    ]
    log = read_log(recordings.write(tmp_path, kind, published(arm(t, q, dq), bare)), make_setup(log={}))
    np.testing.assert_array_equal(measured(log.wrench), w)
    np.testing.assert_array_equal(measured(log.q), q)
    assert any("the headers have no stamps: times of the recorder used" in repair.what for repair in log.repairs)


def temperatures(t, **topics):
    return [
        Other(int(s) + 3, "sensor_msgs/msg/Temperature", {"temperature": first + i, "variance": 0.1}, f"/{topic}")
        for i, s in enumerate(t[::10])
        for topic, first in topics.items()
    ]


def test_the_temperature_of_the_sensor_is_named_where_there_are_several(tmp_path, make_setup):
    t, q, dq, w = random_log()
    warm = temperatures(t, motor=60.0, ft=20.0)
    path = recordings.write(tmp_path, "mcap", published(arm(t, q, dq), wrenches(t, w), warm))
    assert np.isnan(read_log(path, make_setup(log={})).temperature).all()
    log = read_log(path, make_setup(log={"topics": {"temperature": "/ft"}}))
    rows = ~np.isnan(log.temperature)
    np.testing.assert_array_equal(log.temperature[rows], 20.0 + np.arange(6))
    np.testing.assert_allclose(log.t[rows], (t[::10] + 3 - t[0]) * 1e-9, atol=1e-12)


@pytest.mark.parametrize("kind", ["ros1", "sqlite", "mcap"])
def test_a_temperature_that_is_the_only_one_is_the_sensors(tmp_path, make_setup, kind):
    t, q, dq, w = random_log()
    path = recordings.write(tmp_path, kind, published(arm(t, q, dq), wrenches(t, w), temperatures(t, any=20.0)))
    temperature = read_log(path, make_setup(log={})).temperature
    np.testing.assert_array_equal(temperature[~np.isnan(temperature)], 20.0 + np.arange(6))


@pytest.mark.parametrize("kind", FRANKA)
def test_the_state_of_a_franka_has_joints_and_the_external_wrench(tmp_path, kind):
    t, q, dq, w = random_log(7)
    name, definition = FRANKA[kind]
    errors = {"joint_velocity_violation": False, "other": True}
    messages = []
    for s, a, b, x in zip(t, q, dq, w, strict=True):
        if kind == "ros1":
            fields = {"K_F_ext_hat_K": x, "q": a, "dq": b, "O_F_ext_hat_K": -x, "current_errors": errors}
        else:
            joints = {"name": [f"fr3_joint{i}" for i in range(1, 8)], "position": a, "velocity": b, "effort": a}
            wrench = {"wrench": {"force": tuple(x[:3]), "torque": tuple(x[3:])}}
            fields = {"measured_joint_state": joints, "dtau_j": a, "k_f_ext_hat_k": wrench, "current_errors": errors}
        messages.append(Other(int(s), name, fields, "/franka/state", types={name: definition, **ERRORS}))
    path = recordings.write(tmp_path, kind, messages)
    tables = {"robot": {"model": "panda_link8"}, "sensor": {"noise_std": 1.0}}
    log = read_log(path, parse_setup(tables))
    np.testing.assert_array_equal(log.q, q)
    np.testing.assert_array_equal(log.dq, dq)
    np.testing.assert_array_equal(log.wrench, w)
    if kind == "ros1":
        other = parse_setup({**tables, "log": {"topics": {"wrench": "/franka/state:O_F_ext_hat_K"}}})
        np.testing.assert_array_equal(read_log(path, other).wrench, -w)


def test_a_sensor_of_its_own_comes_before_the_robot_s_estimate(tmp_path):
    t, q, _, w = random_log(7)
    name, definition = FRANKA["ros1"]
    robot = [
        Other(int(s), name, {"K_F_ext_hat_K": 9 * x, "q": a}, "/state", types={name: definition, **ERRORS})
        for s, a, x in zip(t, q, w, strict=True)
    ]
    path = recordings.write(tmp_path, "ros1", published(robot, wrenches(t, w)))
    tables = {"robot": {"model": "panda_link8"}, "sensor": {"noise_std": 1.0}}
    np.testing.assert_array_equal(read_log(path, parse_setup(tables)).wrench, w)
    tables["log"] = {"topics": {"wrench": "/state"}}
    np.testing.assert_array_equal(read_log(path, parse_setup(tables)).wrench, 9 * w)


def states(t, q, dq, w, late=0):
    """Messages of an unknown type that contain everything."""
    text = "uint8 mode\nstring name\nfloat64[] angles\nfloat32[2] speeds\nReading[] sensors"
    types = {"my_msgs/msg/State": text, "my_msgs/msg/Reading": "float64[8] data\nfloat32 degrees"}
    for i, (s, a, b, x) in enumerate(zip(t, q, dq, w, strict=True)):
        reading = {"data": np.r_[0, x, 1], "degrees": 20 + i}
        fields = {"mode": 1, "name": "abc", "angles": a, "speeds": b, "sensors": [reading, reading]}
        yield Other(int(s), "my_msgs/msg/State", fields, "/state", int(s) + late, types=types)


TOPICS = {
    "position": "/state:angles",
    "velocity": "/state:speeds",
    "wrench": "/state:sensors[1].data[1:7]",
    "temperature": "/state:sensors[0].degrees",
}


@pytest.mark.parametrize("kind", ["ros1", "sqlite", "mcap", "mcap zstd chunks"])
def test_any_field_of_any_message(tmp_path, make_setup, kind):
    t, q, dq, w = random_log()
    path = recordings.write(tmp_path, kind, states(t, q, dq, w))
    log = read_log(path, make_setup(log={"topics": TOPICS}))
    np.testing.assert_array_equal(log.q, q)
    np.testing.assert_array_equal(log.dq, dq.astype(np.float32))
    np.testing.assert_array_equal(log.wrench, w)
    np.testing.assert_array_equal(log.temperature, 20.0 + np.arange(COUNT))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"wrench": "/state:sensors[1].dat[1:7]"}, r"log\.topics\.wrench: my_msgs/Reading has no field 'dat' .*'data'"),
        ({"wrench": "/state:sensors.data[1:7]"}, r"has 12 numbers for the wrench, not 6 \(choose entries"),
        ({"position": "/state:speeds[0]"}, r"has 1 numbers for the position, not 2"),
        ({"position": "/stat:angles"}, r"log\.topics\.position: there is no topic '/stat' \(did you mean '/state'"),
        ({"position": "/state"}, r'names no field \(add the field: position = "/state:field"'),
        ({"wrench": "/state:name"}, r"'name' is text"),
        ({"wrench": "/state:a b"}, r"'a b' is no field"),
    ],
)
def test_fields_that_do_not_fit_say_so(tmp_path, make_setup, changes, words):
    path = recordings.write(tmp_path, "mcap", states(*random_log()))
    with pytest.raises(LogError, match=words):
        read_log(path, make_setup(log={"topics": TOPICS | changes}))


def test_a_type_that_a_bag_of_humble_does_not_define(tmp_path, make_setup):
    path = recordings.write(tmp_path, "sqlite", states(*random_log()))
    recordings.forget_definitions(path)
    with pytest.raises(LogError, match=r"my_msgs/State, which the recording does not define \(convert it to MCAP"):
        read_log(path, make_setup(log={"topics": TOPICS}))


def test_each_topic_may_have_the_clock_that_the_setup_states(tmp_path, make_setup):
    """The sensor's computer is 40 s ahead, so its headers are useless, unlike those of the joints."""
    t, q, dq, w = random_log()
    ahead = [m._replace(stamp=m.stamp + 40 * SECOND, logged=m.stamp + 2_000_000) for m in wrenches(t, w)]
    joints = [m._replace(logged=m.stamp + 1_000_000) for m in arm(t, q, dq)]
    path = recordings.write(tmp_path, "mcap", published(joints, ahead))
    log = read_log(path, make_setup(log={"clocks": {"wrench": "receipt", "joints": "header"}}))
    rows = ~np.isnan(log.wrench).any(1)
    np.testing.assert_allclose(log.t[rows] + log.start, (t + 2_000_000) * 1e-9, atol=1e-6)
    np.testing.assert_allclose(log.t[~np.isnan(log.q).any(1)] + log.start, t * 1e-9, atol=1e-6)
    assert not any("times of the recorder" in repair.what for repair in log.repairs)
    with pytest.raises(SetupError, match=r"log\.clocks\.wrench: unknown value 'reciept' \(did you mean 'receipt'"):
        make_setup(log={"clocks": {"wrench": "reciept"}})


def test_a_header_without_stamps_is_no_clock(tmp_path, make_setup):
    t, q, dq, w = random_log()
    unset = [m._replace(stamp=0, logged=m.stamp) for m in wrenches(t, w)]
    path = recordings.write(tmp_path, "mcap", published(arm(t, q, dq), unset))
    with pytest.raises(LogError, match=r"log\.clocks\.wrench: /wrench has no stamps in its headers"):
        read_log(path, make_setup(log={"clocks": {"wrench": "header"}}))


IMUS = {
    "sensor_msgs/msg/Imu": lambda w, f: {"angular_velocity": w, "linear_acceleration": f},
    "geometry_msgs/msg/AccelStamped": lambda w, f: {"accel": {"linear": f}},
    "geometry_msgs/msg/AccelWithCovarianceStamped": lambda w, f: {"accel": {"accel": {"linear": f}}},
    "geometry_msgs/msg/Accel": lambda w, f: {"linear": f, "angular": w},
}


@pytest.mark.parametrize("name", IMUS)
def test_imus_and_accelerometers_beside_a_pose(tmp_path, name):
    t, _, _, w = random_log()
    rng = np.random.default_rng(5)
    rate, force = rng.normal(size=(2, COUNT, 3))
    poses = [recordings.Pose(int(s), ("base",), (0, 0, 0, 0, 0, 0, 1)) for s in t]
    imu = [
        Other(int(s) + 5, name, IMUS[name](tuple(a), tuple(f)), "/imu") for s, a, f in zip(t, rate, force, strict=True)
    ]
    path = recordings.write(tmp_path, "mcap", published(poses, imu, wrenches(t, w)))
    tables = {"sensor_pose": {"linear": "specific_force"}, "sensor": {"noise_std": 1.0}}
    log = read_log(path, parse_setup(tables))
    turned = measured(log.dq[:, :4])
    assert len(turned) == (COUNT if name.endswith("Imu") else 0)
    if len(turned):
        np.testing.assert_allclose(turned[1:-1, 1:], rate[1:-1] / 2, atol=1e-9)
    velocity = measured(log.dq[:, 4:])
    steps = np.diff(velocity, axis=0)
    expected = ((force[1:] + force[:-1]) / 2 + [0, 0, -9.81]) * 0.01
    np.testing.assert_allclose(steps, expected, atol=1e-6)
