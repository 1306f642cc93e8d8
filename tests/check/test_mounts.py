"""Mounts: only rotations and a sign; those that a motion about one axis cannot distinguish are listed together."""

import numpy as np
import pytest
from small_checks import BIAS, TABLES, checked, right_log

import ftbias_jax as ft
from ftbias_jax.check.bins import bins_of
from ftbias_jax.check.motion import arm_motion, data_matrices
from ftbias_jax.check.mounts import ROTATIONS, mounts
from ftbias_jax.check.regression import stated_tool
from ftbias_jax.check.state import case_of_bins, stated
from ftbias_jax.setup.rotations import rotation_from_rpy, rotation_from_vector


def about_one_axis(seed, joint):
    """A log of one swinging joint, with the sensor along the flange."""
    rng = np.random.default_rng(seed)
    tables = {**TABLES, "sensor": {"noise_std": [0.1, 0.004]}}
    setup = ft.parse_setup(tables)
    t = np.arange(0, 30, 0.01)
    q, dq, ddq = (np.tile(x, (len(t), 1)) for x in (rng.uniform(-1, 1, 6), np.zeros(6), np.zeros(6)))
    omega, size, phase = 2 * np.pi * rng.uniform(0.05, 0.3, 3), rng.uniform(0.2, 0.7, 3), rng.uniform(0, 6, 3)
    angle = omega * t[:, None] + phase
    q[:, joint] += (size * np.sin(angle)).sum(1)
    dq[:, joint] = (size * omega * np.cos(angle)).sum(1)
    ddq[:, joint] = -(size * omega**2 * np.sin(angle)).sum(1)
    motion = arm_motion(setup.robot, setup.sensor, q, dq, ddq)
    wrench = data_matrices(motion, setup.robot.gravity) @ stated_tool(setup.tool).theta - BIAS
    return tables, {"t": t, "q": q, "dq": dq, "wrench": wrench + setup.sensor.noise_std * rng.normal(size=(len(t), 6))}


def read_turned(arrays, R):
    """The log of a sensor whose axes are turned by R: v_read = R^T v_stated."""
    force, torque = arrays["wrench"][:, :3] @ R, arrays["wrench"][:, 3:] @ R
    return {**arrays, "wrench": np.concatenate([force, torque], 1)}


@pytest.mark.parametrize("joint", [3, 4, 5])
@pytest.mark.parametrize("turn", [(90, 0, 0), (-90, 0, 0), (180, 0, 0), (0, 90, 0), (0, 0, 90), (0, 0, 180)])
def test_a_turn_is_listed_on_a_log_about_one_axis(joint, turn):
    R = rotation_from_vector(np.radians(turn))
    tables, arrays = about_one_axis(0, joint)
    (first,) = checked(tables, read_turned(arrays, R)).findings
    listed = [m.setup["sensor.rotation_rpy"] for m in (first, *first.alike) if m.mistake == "sensor_axes"]
    assert any(np.allclose(rotation_from_rpy(np.array(rpy)), R, atol=0.1) for rpy in listed), str(first)


def test_a_right_log_about_one_axis_is_not_suspected():
    for joint in (1, 3, 4, 5):
        assert checked(*about_one_axis(1, joint)).ok


def test_what_a_log_cannot_tell_apart_is_told_together():
    """The opposite sign may read like a sensor turned by half a turn about the axis of the motion."""
    tables, arrays = about_one_axis(0, 5)
    arrays["wrench"] = -arrays["wrench"]
    found = checked(tables, arrays)
    (first,) = found.findings
    assert first.mistake == "sign"
    assert "sensor_axes" in {other.mistake for other in first.alike}
    assert "or, indistinguishable in this motion: " in str(found)
    (told,) = found.as_dict()["findings"]
    assert [other["mistake"] for other in told["alike"]] == [other.mistake for other in first.alike]
    with pytest.raises(ft.SetupError, match="indistinguishable in this motion"):
        found.require_ok("tune")


def test_every_mount_that_is_tried_is_a_rotation():
    assert len(ROTATIONS) == 24
    tables, arrays = right_log(seed=3)
    setup = ft.parse_setup(tables)
    case = case_of_bins(setup, [bins_of(ft.Log.from_arrays(setup, **arrays), setup)])
    state = stated(case.trimmed(0.6))  # no mount is excluded beforehand
    for other in mounts(state):
        assert set(other.setup) <= {"sensor.rotation_rpy", "sensor.reports", "tool.center_of_mass"}
    tried = [other.setup for other in mounts(state)]
    assert len(tried) == 2 * 2 * 23
    assert sum("sensor.reports" in setup for setup in tried) == 2 * 23


def test_columns_of_a_mirrored_frame_are_told_as_a_turned_sensor_of_the_other_sign():
    tables, arrays = right_log(seed=4)
    mirrored = np.concatenate([arrays["wrench"][:, [1, 0, 2]], arrays["wrench"][:, [4, 3, 5]]], 1)
    (first,) = checked(tables, {**arrays, "wrench": mirrored}).findings
    assert first.mistake == "sensor_axes"
    assert first.setup["sensor.reports"] == "wrench_on_sensor"
    for key, value in first.setup.items():
        section, name = key.split(".")
        tables[section][name] = value
    assert checked(tables, {**arrays, "wrench": mirrored}).ok


@pytest.mark.parametrize("reports", ["wrench_on_tool", "wrench_on_sensor"])
@pytest.mark.parametrize("gravity", [[0.0, 0.0, 9.81], [9.81, 0.0, 0.0]])
def test_a_turned_sensor_on_an_arm_that_hangs_is_found_with_its_gravity(gravity, reports):
    """Neither gravity nor the mount alone explains the force; accelerations distinguish the sign from gravity."""
    tables, arrays = right_log(seed=5, robot={**TABLES["robot"], "gravity": gravity})
    turned = read_turned(arrays, rotation_from_vector([0, 0, np.radians(35)]))
    stated_wrong = {**tables, "robot": TABLES["robot"], "sensor": {**tables["sensor"], "reports": reports}}
    (first,) = checked(stated_wrong, turned).findings
    assert first.mistake == "sensor_axes"
    assert first.setup["robot.gravity"] == gravity
    assert first.setup.get("sensor.reports", reports) == "wrench_on_tool"


def test_an_arm_that_hangs_is_told_from_a_sensor_of_the_opposite_sign():
    """Of both, the weight is the same: only accelerations tell them apart."""
    tables, arrays = right_log(seed=6, robot={**TABLES["robot"], "gravity": [0.0, 0.0, 9.81]})
    drafted = {**tables, "robot": TABLES["robot"], "sensor": {**tables["sensor"], "reports": "wrench_on_sensor"}}
    (first,) = checked(drafted, arrays).findings
    assert first.setup == {"robot.gravity": [0.0, 0.0, 9.81], "sensor.reports": "wrench_on_tool"}
    assert checked(tables, arrays).ok


def test_a_centre_of_mass_that_is_not_measured_is_not_turned():
    tables, arrays = right_log(seed=7)
    turned = read_turned(arrays, rotation_from_vector([0, 0, np.pi / 2]))
    for tool in ({}, {**tables["tool"], "mass_std": 0.1, "center_of_mass_std": [0.01] * 3}):
        (first,) = checked({**tables, "tool": tool}, turned).findings
        assert first.mistake == "sensor_axes"
        assert "tool.center_of_mass" not in first.setup
    assert "tool.center_of_mass" in checked(tables, turned).findings[0].setup
