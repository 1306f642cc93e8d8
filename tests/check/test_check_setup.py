"""Mistakes of content are recognised, and right setups are not suspected."""

import json
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import small_checks
from scipy.signal import butter, lfilter
from small_checks import checked, right_log

import ftbias_jax as ft
from ftbias_jax.check import check_setup as module
from ftbias_jax.check.motion import arm_motion
from ftbias_jax.check.result import MISTAKES, Check, Mistake
from ftbias_jax.io.cleaning import slices
from ftbias_jax.types import AXES


def names(check):
    return [finding.mistake for finding in check.findings]


def turned(P):
    P = np.array(P, float)
    return lambda tables, arrays: arrays.update(
        wrench=np.concatenate([arrays["wrench"][:, :3] @ P.T, arrays["wrench"][:, 3:] @ P.T], 1)
    )


def scaled(*factors):
    return lambda tables, arrays: arrays.update(wrench=arrays["wrench"] * np.repeat(factors, 3))


def setting(section, **values):
    return lambda tables, arrays: tables[section].update(values)


def shifted(seconds):
    def change(tables, arrays):
        step = round(100 * seconds)
        arrays["wrench"] = np.roll(arrays["wrench"], step, 0)
        arrays["wrench"][:step] = np.nan

    return change


CHANGES = {
    "sign": (setting("sensor", reports="wrench_on_sensor"), {"sensor.reports": "wrench_on_tool"}),
    "gravity": (setting("robot", gravity=[0.0, 0.0, 9.81]), {"robot.gravity": [0.0, 0.0, -9.81]}),
    "wrench_units": (scaled(1 / 9.80665, 1 / 9.80665), {}),
    "tool_units": (setting("tool", mass=800.0), {"tool.mass": 0.8}),
    "angle_units": (
        lambda tables, arrays: arrays.update(q=np.degrees(arrays["q"]), dq=np.degrees(arrays["dq"])),
        {"log.angle_unit": "deg"},
    ),
    "force_torque_swapped": (lambda t, arrays: arrays.update(wrench=arrays["wrench"][:, [3, 4, 5, 0, 1, 2]]), {}),
    "sensor_axes": (turned([[0, -1, 0], [1, 0, 0], [0, 0, 1]]), None),
    "compensated": (
        lambda t, arrays: arrays.update(wrench=0.1 * np.random.default_rng(1).normal(size=arrays["wrench"].shape)),
        {"sensor.compensated": "tool"},
    ),
    "time_offset": (shifted(0.8), {"effects.time_delay.delay": 0.8}),
    "raw_offset": (lambda t, arrays: arrays.update(wrench=arrays["wrench"] - 12800.0), None),
}


@pytest.mark.parametrize("cutoff", [0.45, 0.6, 1.0])
def test_a_sensor_with_a_low_cutoff_is_no_clock_that_differs(cutoff):
    """A second-order Butterworth filter delays slow signals by 0.23 s divided by its cutoff in Hz."""
    tables, arrays = right_log(seed=3)
    wrench = lfilter(*butter(2, cutoff, fs=100), arrays["wrench"] - arrays["wrench"][0], axis=0) + arrays["wrench"][0]
    assert names(checked(tables, arrays | {"wrench": wrench})) == []
    CHANGES["time_offset"][0](tables, arrays)
    assert names(checked(tables, arrays)) == ["time_offset"]


def joints(change):
    return lambda tables, arrays: arrays.update({name: change(name, arrays[name]) for name in ("q", "dq")})


JOINTS = {
    "joint2 and joint5 have changed places": joints(lambda _, x: x[:, [0, 4, 2, 3, 1, 5]]),
    "joint4 moves the other way": joints(lambda _, x: x * [1, 1, 1, -1, 1, 1]),
    "zero of joint3 is 90 degrees off": joints(lambda name, x: x - np.pi / 2 * (np.arange(6) == 2) * (name == "q")),
}


@pytest.mark.parametrize("words", JOINTS)
def test_joints_in_another_order_direction_or_zero_are_named(words):
    """Another sign, gravity, mount or a subtracted payload would explain part of each mistake."""
    tables, arrays = right_log(seed=3)
    JOINTS[words](tables, arrays)
    (finding,) = checked(tables, arrays).findings
    assert finding.mistake == "joint_convention"
    assert words in finding.remedy
    assert finding.evidence["rms_if_mended"] < 0.2 * finding.evidence["rms_as_stated"]


@pytest.mark.parametrize("channel", range(6))
def test_one_channel_of_the_opposite_sign_is_named(channel):
    """A turned sensor that reports the opposite sign would explain a force, and no torque beside it."""
    tables, arrays = right_log(seed=3)
    arrays["wrench"] = arrays["wrench"] * np.where(np.arange(6) == channel, -1, 1)
    (finding,) = checked(tables, arrays).findings
    assert finding.mistake == "sign"
    assert finding.remedy.startswith(f"{AXES[channel]} has the opposite sign")


@pytest.mark.parametrize(("mass", "much"), [(0.8, False), (1.3, True)])
def test_where_much_is_left_it_is_said_that_no_mistake_explains_it(mass, much):
    tables, arrays = right_log(seed=3)
    tables["tool"]["mass"] = mass
    found = checked(tables, arrays)
    assert names(found) == []
    assert ("more is left than the usual effects leave" in str(found)) == much


@pytest.mark.parametrize("joint", [1, 3])
def test_one_joint_in_degrees_is_named(joint):
    """Its accelerations are so large that the weight seems to be absent from the reading."""
    tables, arrays = right_log(seed=3)
    joints(lambda _, x: np.where(np.arange(6) == joint, np.degrees(x), x))(tables, arrays)
    (finding,) = checked(tables, arrays).findings
    assert finding.mistake == "angle_units"
    assert f"joint{joint + 1} is in degrees, the other joints are not" in finding.remedy


@pytest.mark.parametrize("mistake", CHANGES)
def test_a_mistake_is_named_with_what_mends_it(mistake):
    tables, arrays = right_log(seed=3)
    change, setup = CHANGES[mistake]
    change(tables, arrays)
    found = checked(tables, arrays)
    assert names(found) == [mistake]
    assert not found.ok
    if setup is not None:
        told = found.findings[0].setup
        assert told.keys() == setup.keys()
        for key, value in setup.items():
            assert told[key] == (value if isinstance(value, str) else pytest.approx(value, abs=0.06))


@pytest.mark.parametrize("mistake", ["sign", "gravity", "tool_units", "sensor_axes", "compensated", "raw_offset"])
def test_a_setup_that_is_mended_as_told_is_right(mistake):
    tables, arrays = right_log(seed=4)
    CHANGES[mistake][0](tables, arrays)
    (finding,) = checked(tables, arrays).findings
    for key, value in finding.setup.items():
        section, name = key.split(".")
        tables.setdefault(section, {})[name] = value
    assert checked(tables, arrays).ok


UNITS = {
    "pound-force instead": (1 / 4.4482216, 1 / 4.4482216),
    "millinewton instead": (1e3, 1e3),
    "gram-force instead": (102.0, 102.0),
    "Nmm instead": (1.0, 1e3),
    "kilogram-force instead": (1 / 9.80665, 1 / 9.80665),
    "kgf and kgf cm": (1 / 9.80665, 100 / 9.80665),
    "kgf and Nm": (1 / 9.80665, 1.0),
    "lbf and lbf ft": (1 / 4.4482216, 0.7375621),
}
"""Words of a remedy -> number of these units in 1 N and in 1 Nm."""


@pytest.mark.parametrize("words", UNITS)
def test_other_units_of_the_wrench_are_told_apart(words):
    """Among units that fit with a somewhat different tool, those are named that fit with the stated one."""
    tables, arrays = right_log(seed=5)
    scaled(*UNITS[words])(tables, arrays)
    (finding,) = checked(tables, arrays).findings
    assert words in finding.remedy


def test_angles_of_the_mount_in_degrees_are_recognised_by_what_was_written():
    tables, arrays = right_log()
    tables["sensor"]["rotation_rpy"] = [0.0, 0.0, 30.0]
    (finding,) = checked(tables, arrays).findings
    assert finding.mistake == "angle_units"
    np.testing.assert_allclose(finding.setup["sensor.rotation_rpy"], [0, 0, np.pi / 6])


def test_what_is_on_no_list_is_worse_than_raw():
    tables, arrays = right_log()
    tables["tool"]["mass"] = 3 * 0.8
    found = checked(tables, arrays)
    assert names(found) == ["worse_than_raw"]
    assert found.worse_than_raw
    assert found.lines()[0].startswith("with this setup the corrected wrench is worse than the raw one: ")
    assert "another tool explains the reading" in found.findings[0].remedy
    for command in ("identify", "diagnose", "calibrate"):  # commands that may start from a wrong tool
        found.require_ok(command)
    with pytest.raises(ft.LogError, match=r"worse than doing nothing \(another tool"):
        found.require_ok("tune")


def test_a_mount_at_an_odd_angle_is_found():
    tables, arrays = right_log()
    c, s = np.cos(2.4), np.sin(2.4)
    turned([[c, -s, 0], [s, c, 0], [0, 0, 1]])(tables, arrays)
    (finding,) = checked(tables, arrays).findings
    assert finding.mistake == "sensor_axes"
    expected = tables["sensor"]["rotation_rpy"][2] - 2.4  # readings turn opposite to the axes
    np.testing.assert_allclose(finding.setup["sensor.rotation_rpy"], [0, 0, expected], atol=0.05)


def contact(tables, arrays):
    arrays["wrench"][500:900, 2] += 25.0


def strong_drift(tables, arrays):
    arrays["wrench"] += np.cumsum(np.cumsum(np.random.default_rng(0).normal(size=arrays["wrench"].shape), 0), 0) * 2e-4


def late(tables, arrays):
    arrays["wrench"] = np.roll(arrays["wrench"], 5, 0)


RIGHT = {
    "as it is": lambda tables, arrays: None,
    "heavier": setting("tool", mass=0.72),
    "lighter": setting("tool", mass=1.1),
    "another centre of mass": setting("tool", center_of_mass=[0.03, -0.005, 0.045]),
    "gain": lambda t, arrays: arrays.update(wrench=arrays["wrench"] * [1.1, 0.9, 1.1, 0.9, 1.1, 0.9]),
    "tilted": setting("robot", gravity=[0.5, -0.5, -9.78]),
    "mount": setting("sensor", rotation_rpy=[0.05, -0.05, 0.6]),
    "encoder": lambda t, arrays: arrays.update(q=arrays["q"] + [0, 0, 0.08, 0, 0, 0]),
    "late": late,
    "contact": contact,
    "strong drift": strong_drift,
    "noise": lambda t, arrays: arrays.update(
        wrench=arrays["wrench"] + np.random.default_rng(0).normal(size=(3000, 6)) * [2, 2, 2, 0.1, 0.1, 0.1]
    ),
    "an axis missing": lambda t, arrays: arrays["wrench"].__setitem__((slice(None), 4), np.nan),
    "at rest": lambda t, arrays: arrays.update(
        q=arrays["q"][:1] + 0 * arrays["q"], dq=0 * arrays["dq"], wrench=arrays["wrench"][:1] + 0 * arrays["wrench"]
    ),
    "no tool": setting("tool", mass=1e-6),
}


@pytest.mark.parametrize("effect", RIGHT)
def test_no_effect_is_taken_for_a_mistake(effect):
    tables, arrays = right_log(seed=6)
    if effect == "no tool":
        arrays["wrench"] = 0.1 * np.random.default_rng(0).normal(size=arrays["wrench"].shape)
    RIGHT[effect](tables, arrays)
    if effect == "at rest":
        arrays["wrench"] = arrays["wrench"] + 0.1 * np.random.default_rng(0).normal(size=arrays["wrench"].shape)
    found = checked(tables, arrays)
    assert found.ok, str(found)


def test_a_tool_that_is_merely_wrong_is_no_mistake_of_units():
    for factor in (0.4, 2.5):
        tables, arrays = right_log(seed=7)
        tables["tool"]["mass"] = 0.8 * factor
        found = checked(tables, arrays)
        assert set(names(found)) <= {"worse_than_raw"}
        found.require_ok("identify")


def test_a_sensor_that_was_zeroed_with_its_tool_needs_a_word_in_the_setup():
    tables, arrays = right_log(seed=8)
    rest = np.repeat(np.arange(3000), np.where(np.arange(3000) == 0, 101, 1))  # the arm stands still for a second
    arrays = {name: values[rest] for name, values in arrays.items()}
    arrays["t"] = np.arange(len(rest)) / 100
    arrays["dq"][:101] = 0
    arrays["wrench"] = arrays["wrench"] - arrays["wrench"][0]
    arrays["wrench"][:101] = 0.1 * np.random.default_rng(0).normal(size=(101, 6)) * [1, 1, 1, 0.04, 0.04, 0.04]
    found = checked(tables, arrays)
    assert names(found) == ["rezeroed"]
    assert found.findings[0].harmless
    found.require_ok("tune")  # results are right nevertheless
    tables["sensor"]["rezeroed"] = True
    assert checked(tables, arrays).ok


def pushed(arrays, share):
    """A robot that is pushed in changing directions for a share of the log around its middle."""
    rng = np.random.default_rng(0)
    count = len(arrays["t"])
    inside = np.abs(np.arange(count) / count - 0.45) < share / 2
    force = np.stack([np.interp(arrays["t"], np.arange(0, 40, 0.4), rng.normal(0, 15, 100)) for _ in range(6)], 1)
    arrays["wrench"] = arrays["wrench"] + inside[:, None] * force * [1, 1, 1, 0.1, 0.1, 0.1]


@pytest.mark.parametrize("mistake", ["sign", "wrench_units", "tool_units", "force_torque_swapped"])
def test_a_mistake_is_named_though_the_robot_is_pushed_for_most_of_the_log(mistake):
    tables, arrays = right_log(seed=3)
    pushed(arrays, 0.55)
    assert checked(tables, arrays).ok
    CHANGES[mistake][0](tables, arrays)
    assert names(checked(tables, arrays))[0] == mistake


def test_findings_are_written_as_the_formats_say(tmp_path):
    tables, arrays = right_log()
    setting("sensor", reports="wrench_on_sensor")(tables, arrays)
    found = checked(tables, arrays)
    found.to_json(tmp_path / "check.json")
    content = json.loads((tmp_path / "check.json").read_text())
    assert content["ok"] is False
    (finding,) = content["findings"]
    assert finding["mistake"] == "sign"
    assert finding["setup"] == {"sensor.reports": "wrench_on_tool"}
    assert finding["evidence"]["rms_if_mended"] < 0.1 * finding["evidence"]["rms_as_stated"]
    assert str(found).startswith('sign: the sensor reports the wrench on tool: set sensor.reports = "wrench_on_tool" (')


def test_every_mistake_has_its_words_and_a_refusal_names_file_and_remedy():
    for name in MISTAKES:
        check = Check((Mistake(name, {}, "mend it"),), {}, "setup.toml")
        remedy = "mend it" + "; ftbias identify --mounting finds any rotation of the sensor" * (name == "sensor_axes")
        with pytest.raises(ft.LogError, match=rf"^setup.toml: {name}: .* \({remedy}; --unchecked goes on anyway\)"):
            check.require_ok("tune")


def test_short_logs_and_no_logs():
    tables, arrays = right_log(duration=1.0)
    found = checked(tables, arrays)
    assert found.ok
    assert "too short" in str(found)
    with pytest.raises(ft.UsageError, match="no log"):
        ft.check_setup(ft.parse_setup(tables), [])


def test_a_log_in_parts_and_several_logs_give_the_same_answer(monkeypatch):
    tables, arrays = right_log()
    setting("robot", gravity=[0.0, 0.0, 9.81])(tables, arrays)
    setup = ft.parse_setup(tables)
    log = ft.Log.from_arrays(setup, **arrays)
    monkeypatch.setattr(module, "PART", 700)
    assert names(module.check_parts(setup, slices(log), len(log.t))) == ["gravity"]
    assert names(ft.check_setup(setup, [log, log])) == ["gravity"]


def test_it_takes_no_time_where_the_setup_is_right():
    tables, arrays = right_log(duration=60.0)
    setup = ft.parse_setup(tables)
    log = ft.Log.from_arrays(setup, **arrays)
    start = time.process_time()
    assert ft.check_setup(setup, [log]).ok
    assert time.process_time() - start < 1.0


def test_conventions_of_a_recorded_pose_are_recognised_together():
    """A quaternion in the other order, a position in the body's axes and a gyroscope in deg/s, all in one log."""
    tables, arrays = pose_log()
    setup = ft.parse_setup(tables)
    R, p = arrays.pop("rotation"), arrays["position"]
    assert ft.check_setup(setup, [ft.Log.from_arrays(setup, q=None, **arrays)]).ok
    wrong = {
        **arrays,
        "orientation": arrays["orientation"][:, [3, 0, 1, 2]],
        "position": np.einsum("nji,nj->ni", R, p),
        "angular_velocity": np.degrees(arrays["angular_velocity"]),
    }
    found = ft.check_setup(setup, [ft.Log.from_arrays(setup, q=None, **wrong)])
    assert names(found) == ["quaternion_convention", "position_frame", "gyroscope_units"]
    assert [dict(finding.setup) for finding in found.findings] == [
        {"sensor_pose.orientation": "quaternion_wxyz"},
        {"sensor_pose.position_axes": "body"},
        {"log.angle_unit": "deg"},
    ]


def test_a_conjugate_orientation_is_mended_by_the_key_that_states_it():
    tables, arrays = pose_log()
    arrays.pop("rotation")
    wrong = {**arrays, "orientation": arrays["orientation"] * [-1, -1, -1, 1]}
    for stated in (False, True):
        setup = ft.parse_setup({**tables, "sensor_pose": {"conjugate": stated}})
        given = arrays if stated else wrong
        (finding,) = ft.check_setup(setup, [ft.Log.from_arrays(setup, q=None, **given)]).findings
        assert finding.setup == {"sensor_pose.conjugate": not stated}
        assert finding.remedy.endswith(f"set sensor_pose.conjugate = {str(not stated).lower()}")
        mended = ft.parse_setup({**tables, "sensor_pose": {"conjugate": not stated}})
        assert ft.check_setup(mended, [ft.Log.from_arrays(mended, q=None, **given)]).ok


def pose_log():
    from ftbias_jax.check.motion import arm_motion, in_sensor
    from ftbias_jax.io.pose import continuous, quaternions_of

    tables, arrays = right_log(seed=11)
    setup = ft.parse_setup(tables)
    motion = arm_motion(setup.robot, setup.sensor, *small_checks.motion_of_joints(arrays["t"], 11))
    quaternion = continuous(quaternions_of(motion.rotation))[:, [1, 2, 3, 0]]
    pose = {"sensor_pose": {}, "sensor": {"noise_std": [0.1, 0.004]}, "tool": tables["tool"]}
    return pose, {
        "t": arrays["t"],
        "wrench": arrays["wrench"],
        "orientation": quaternion,
        "position": motion.position,
        "angular_velocity": in_sensor(motion, motion.velocity),
        "rotation": motion.rotation,
    }


def test_the_key_that_a_tare_on_the_way_is_told_with_makes_the_setup_right():
    tables, arrays = right_log(seed=9)
    for row in (900, 1500):
        arrays["wrench"][row:] -= arrays["wrench"][row]
    arrays["t"] = arrays["t"] + 1.7e9  # absolute stamps, as in recordings
    (finding,) = checked(tables, arrays).findings
    expected = [1.7e9 + 8.995, 1.7e9 + 14.995]  # between two samples
    assert finding.setup["sensor.rezeroed_at"] == pytest.approx(expected, abs=1e-5, rel=0)
    assert finding.evidence["times"] == finding.setup["sensor.rezeroed_at"]
    assert "set sensor.rezeroed_at = [1700000008.995, 1700000014.995]" in finding.remedy
    tables["sensor"]["rezeroed_at"] = [finding.setup["sensor.rezeroed_at"][1]]
    (rest,) = checked(tables, arrays).findings  # one is stated, the other remains
    assert rest.setup["sensor.rezeroed_at"] == finding.setup["sensor.rezeroed_at"]
    tables["sensor"]["rezeroed_at"] = rest.setup["sensor.rezeroed_at"]
    assert checked(tables, arrays).ok


def test_tares_of_several_logs_are_told_without_a_key():
    tables, arrays = right_log(seed=9)
    setup = ft.parse_setup(tables)
    right = ft.Log.from_arrays(setup, **arrays)
    arrays["wrench"][1500:] -= arrays["wrench"][1500]
    (finding,) = ft.check_setup(setup, [right, ft.Log.from_arrays(setup, **arrays)]).findings
    assert finding.mistake == "rezeroed"
    assert not finding.setup
    assert "check this log on its own to get the times to the sample" in finding.remedy


def pulled_by(tables, arrays, force, lever):
    """Add a steady force to the log: N in base axes, on the tool at ``lever``, m in the sensor's frame."""
    setup = ft.parse_setup(tables)
    rotation = arm_motion(setup.robot, setup.sensor, *(arrays[name] for name in ("q", "dq", "dq"))).rotation
    pull = np.einsum("nji,j->ni", rotation, np.array(force))
    arrays["wrench"] = arrays["wrench"] + np.concatenate([pull, np.cross(lever, pull)], 1)


PULLS = [
    (16, (-5.9, 1.1, -2.5), (0.05, -0.1, 0.02)),  # a turned sensor explains part of it
    (14, (8.0, 0.0, 8.0), (0.0, 0.0, 0.1)),
    (15, (-2.5, -2.0, -4.8), (-0.07, -0.04, 0.02)),  # here the stated tool does worse than none
    (18, (0.8, -2.8, -5.8), (-0.05, 0.06, 0.01)),
]


@pytest.mark.parametrize(("seed", "force", "lever"), PULLS)
def test_a_tool_on_a_weight_balancer_is_no_mistake_of_the_setup(seed, force, lever):
    tables, arrays = right_log(seed=seed)
    pulled_by(tables, arrays, force, lever)
    found = checked(tables, arrays)
    assert found.ok, str(found)


@pytest.mark.parametrize("P", [np.diag([-1, -1, 1]), np.diag([1, -1, -1]), [[0, -1, 0], [1, 0, 0], [0, 0, 1]]])
def test_a_turned_sensor_is_found_on_a_tool_that_hangs_on_a_weight_balancer(P):
    tables, arrays = right_log(seed=13)
    pulled_by(tables, arrays, (1.0, 0.0, 1.0), (0.0, 0.0, 0.1))
    turned(P)(tables, arrays)
    assert names(checked(tables, arrays)) == ["sensor_axes"]


@pytest.fixture
def several(tmp_path):
    """A setup, and logs as files in which the reading has the opposite sign."""
    tables, arrays = right_log(seed=5)
    arrays["wrench"] = -arrays["wrench"]
    setup = ft.parse_setup(tables)
    paths = [tmp_path / f"{i}.npz" for i in range(3)]
    for path in paths:
        np.savez(path, **arrays)
    return setup, paths


def test_workers_of_an_executor_read_logs_for_the_same_answer(several):
    setup, paths = several
    logs = [ft.read_log(path, setup) for path in paths]
    expected = ft.check_setup(setup, logs)
    assert names(expected) == ["sign"]
    with ThreadPoolExecutor(2) as executor:
        assert (
            str(ft.check_setup(setup, paths, executor=executor)) == str(ft.check_setup(setup, paths)) == str(expected)
        )
        assert str(ft.check_setup(setup, paths[:1], executor=executor)) == str(ft.check_setup(setup, logs[:1]))
        with pytest.raises(ft.LogError, match=r"none.npz"):
            ft.check_setup(setup, [*paths, "none.npz"], executor=executor)


@pytest.mark.parametrize("mass", [0.4, 0.5])
def test_a_payload_that_is_not_the_tool_is_no_other_unit(mass):
    """The controller subtracts the weight of something lighter than the tool: a part of its weight is left."""
    tables, arrays = right_log(seed=8)
    setup = ft.parse_setup(tables)
    R = arm_motion(setup.robot, setup.sensor, arrays["q"], 0 * arrays["q"], 0 * arrays["q"]).rotation
    weight = -mass * np.einsum("nji,j->ni", R, setup.robot.gravity)
    arrays["wrench"] = arrays["wrench"] - np.concatenate([weight, np.cross([0.0, 0.01, 0.05], weight)], 1)
    (first,) = checked(tables, arrays).findings
    assert first.mistake == "compensated"
    assert f"the weight of {mass:.3g}" in first.remedy
    assert first.setup == {}
