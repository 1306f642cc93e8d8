"""The standard calibration: a tool from static poses of an arm, of a recorded orientation, and of a real sensor."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import ftbias_jax as ft
from ftbias_jax.calibration.identify import KEPT
from ftbias_jax.model.kinematics.screws import sensor_pose
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.setup import parse_setup
from ftbias_jax.setup.rotations import rotation_from_vector, vector_from_rotation

MASS, CENTER = 0.9, np.array([0.01, -0.02, 0.06])
BIAS = np.array([3.0, -1.0, 8.0, 0.2, -0.4, 0.1])
NOISE = np.repeat([0.05, 0.002], 3)


def setup_of(**sections):
    tables = {
        "robot": {"model": "panda"},
        "sensor": {"noise_std": [0.1, 0.004]},
        "tool": {"mass": 0.5, "center_of_mass": [0, 0, 0.02], "inertia": [0.002, 0, 0, 0.002, 0, 0.001]},
    }
    return parse_setup(tables | sections)


def readings(rotations, seed=0):
    rng = np.random.default_rng(seed)
    s = np.einsum("nji,j->ni", rotations, [0, 0, 9.80665])
    return (
        np.concatenate([MASS * s, np.cross(MASS * CENTER, s)], 1) - BIAS + NOISE * rng.normal(size=(len(rotations), 6))
    )


def check(found):
    tool = found.tool
    assert found.converged
    assert (np.abs(tool.values[:4] - [MASS, *CENTER]) < 4 * tool.stderr[:4]).all()
    assert (tool.stderr[:4] < [0.01, 1e-3, 1e-3, 1e-3]).all()
    assert (np.abs(tool.bias - BIAS) < 4 * tool.bias_stderr).all()
    np.testing.assert_array_equal(found.setup.tool.inertia, [0.002, 0, 0, 0.002, 0, 0.001])
    assert tool.remarks[4:] == (KEPT,) * 6
    assert np.isnan(tool.stderr[4:]).all()
    np.testing.assert_allclose(found.poses.left_out, [0.05, 0.002], rtol=0.4)


@pytest.mark.parametrize("turn", [None, [0.05, np.pi, -0.02]], ids=["as stated", "half a turn off"])
def test_poses_of_an_arm(turn):
    setup = setup_of()
    mounted = np.eye(3) if turn is None else rotation_from_vector(np.array(turn))
    q = np.random.default_rng(1).uniform(-2.5, 2.5, (20, 7))
    arm = params_from_setup(setup).arm
    rotations = np.stack([np.asarray(sensor_pose(arm, jnp.asarray(row))[0]) for row in q]) @ mounted
    found = ft.identify_tool(setup, ft.Poses.from_arrays(setup, readings(rotations), q), mounting=turn is not None)
    check(found)
    miss = vector_from_rotation(mounted.T @ found.setup.sensor.rotation)
    assert np.abs(miss).max() < 0.02
    if turn is None:
        np.testing.assert_array_equal(found.setup.sensor.rotation, setup.sensor.rotation)
        np.testing.assert_allclose(found.poses.plain, found.tool.values[:4], rtol=1e-3, atol=1e-6)
    assert np.linalg.norm(found.tool.rotation) <= np.pi


def recorded(count=12, seed=0):
    """A setup with a recorded orientation, matrices (N, 3, 3), and the readings."""
    rng = np.random.default_rng(seed)
    rotations = np.stack([rotation_from_vector(rng.uniform(-2, 2, 3)) for _ in range(count)])
    return setup_of(robot={}, sensor_pose={"orientation": "matrix", "linear": "none"}), rotations, readings(rotations)


def test_poses_of_a_recorded_orientation_and_the_prior_for_the_next_log(tmp_path):
    setup, rotations, wrench = recorded()
    found = ft.identify_tool(setup, ft.Poses.from_arrays(setup, wrench, orientation=rotations), bias=True)
    check(found)
    text = str(found)
    assert "12 static poses, constant bias; each predicted from the others: rms" in text
    assert "plain least squares: 0.9" in text
    assert text.count(KEPT) == 6
    found.save(tmp_path / "found.toml")
    written = ft.load_setup(tmp_path / "found.toml")
    np.testing.assert_allclose(written.bias.initial, found.tool.bias)
    np.testing.assert_allclose(written.bias.initial_std, found.tool.bias_stderr)
    assert KEPT in (tmp_path / "found.toml").read_text(encoding="utf-8")


def test_poses_that_do_not_turn_determine_nothing_and_write_nothing(tmp_path):
    setup, rotations, _ = recorded()
    same = np.repeat(rotations[:1], 12, 0)
    found = ft.identify_tool(setup, ft.Poses.from_arrays(setup, readings(same), orientation=same))
    assert found.tool.remarks == (KEPT,) * 10
    np.testing.assert_array_equal(found.tool.values[:4], [0.5, 0, 0, 0.02])
    with pytest.raises(ft.LogError, match="determines no parameter of the tool"):
        found.save(tmp_path / "found.toml")
    with pytest.raises(ft.LogError, match="did not converge"):
        replace(found, tool=found.tool._replace(converged=False)).save(tmp_path / "found.toml")
    assert not (tmp_path / "found.toml").exists()


def test_the_published_calibration_of_a_real_sensor(shared_data):
    """24 poses of a KUKA LBR Med with an ATI Gamma; gravity as published with them."""
    file = shared_data / "real" / "kuka_ati" / "0-calibration_fts-accel.csv"
    if not file.exists():
        pytest.skip(f"there is no {file}")
    pose = {"orientation": "matrix", "linear": "none"}
    sensor = {"noise_std": [0.035, 0.021, 0.075, 0.0012, 0.0019, 0.00026], "reports": "wrench_on_sensor"}
    setup = setup_of(robot={"gravity": [0, 0, -9.82085]}, sensor_pose=pose, sensor=sensor)
    poses = ft.read_poses(file, setup)
    found = ft.identify_tool(setup, poses)
    assert len(poses.t) == 24
    np.testing.assert_allclose(found.tool.values[0], 0.93231, atol=1e-4)
    np.testing.assert_allclose(1e3 * found.tool.values[1:4], [0.28, 0.05, 43.90], atol=0.01)
    np.testing.assert_allclose(found.tool.bias, [9.077, -1.018, 9.985, 0.4325, -0.6916, -0.1570], atol=1e-3)
    np.testing.assert_allclose(found.tool.values[:4], found.poses.plain, rtol=1e-3)
    np.testing.assert_array_equal(found.setup.tool.inertia, setup.tool.inertia)


@pytest.mark.parametrize(
    ("mistake", "sign", "unit"), [("sign", -1, 1), ("angle_units", 1, 180 / np.pi)], ids=["sign", "degrees"]
)
@pytest.mark.parametrize("tool", [{"mass": 0.85, "center_of_mass": [0, 0, 0.05]}, None], ids=["stated", "unknown"])
def test_a_wrong_setup_is_refused_before_a_tool_is_fitted_to_it(mistake, sign, unit, tool):
    """Without the check, `identify` silently wrote a mass below zero."""
    setup = setup_of(tool=tool or {})
    q = np.random.default_rng(1).uniform(-2.5, 2.5, (20, 7))
    arm = params_from_setup(setup_of()).arm
    rotations = np.stack([np.asarray(sensor_pose(arm, jnp.asarray(row))[0]) for row in q])
    poses = ft.Poses.from_arrays(setup, sign * readings(rotations), unit * q)
    with pytest.raises(ft.SetupError, match=f"{mistake}: .*--unchecked"):
        ft.identify_tool(setup, poses)
    assert ft.identify_tool(setup, poses, unchecked=True).tool.converged


@pytest.mark.parametrize("touched", [9, 23])
def test_a_pose_that_was_touched_is_named_and_left_out(touched):
    """Also the last one, after which the bias would seem to have drifted."""
    setup, _, _ = recorded()
    rotations = Rotation.random(24, random_state=3).as_matrix()
    wrench, others = readings(rotations), np.delete(np.arange(24), touched)
    clean = ft.identify_tool(
        setup, ft.Poses.from_arrays(setup, wrench[others], orientation=rotations[others], t=100.0 * others)
    )
    wrench[touched] += [0, 9, 12, 0.5, 0, 0]
    found = ft.identify_tool(setup, ft.Poses.from_arrays(setup, wrench, orientation=rotations, t=100.0 * np.arange(24)))
    ((pose, force, torque),) = found.poses.touched
    assert pose == touched + 1
    assert force == pytest.approx(15, rel=0.1)
    assert torque == pytest.approx(0.5, rel=0.2)
    np.testing.assert_allclose(found.tool.values, clean.tool.values, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.tool.bias, clean.tool.bias, rtol=1e-6)
    assert f"pose {touched + 1} is left out: " in str(found)
    assert clean.poses.touched == ()
