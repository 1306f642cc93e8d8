"""A log of the sensor's pose gives the bias that the joints of the same simulated log give."""

import tomllib
from dataclasses import replace

import by_params
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from stated import MOUNTED, YAW_PITCH_ROLL, pose_setup

import ftbias_jax as ft
from ftbias_jax.cli.commands.filter import filter_file
from ftbias_jax.filtering import params_for_log
from ftbias_jax.filtering.samples import samples_from_log
from ftbias_jax.io import read_log
from ftbias_jax.io.parts import open_log
from ftbias_jax.io.pose import quaternions_of
from ftbias_jax.io.write.npz import load_npz
from ftbias_jax.model import simulate
from ftbias_jax.model.kinematics.screws import make_arm, sensor_motion
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.model.simulate import Trajectory
from ftbias_jax.setup import dump_setup, parse_setup

RATE, SECONDS = 200, 30
ARM = YAW_PITCH_ROLL | MOUNTED


@pytest.fixture(scope="module")
def truth():
    """The simulated log, the flange's pose, and an IMU at the sensor; the wrist turns all the way round."""
    setup = parse_setup(ARM)
    params = params_from_setup(setup)
    t = np.arange(RATE * SECONDS) / RATE
    rate, size = np.array([0.9, 0.7, 1.3]), np.array([0.8, 0.6, 3.5])
    phase = t[:, None] * rate + [0, 1, 2]
    motion = (size * np.sin(phase), size * rate * np.cos(phase), -size * rate**2 * np.sin(phase))
    trajectory = Trajectory(*map(jnp.asarray, (t, *motion)))
    truth = jax.tree.map(np.array, simulate.simulate(jax.random.key(0), params, trajectory))
    robot = setup.robot
    flange = make_arm(robot.screws, robot.flange_translation, robot.flange_rotation)
    body = jax.tree.map(np.array, jax.vmap(lambda *x: sensor_motion(flange, *x))(*map(jnp.asarray, motion)))
    sensor = jax.tree.map(np.array, jax.vmap(lambda *x: sensor_motion(params.arm, *x))(*map(jnp.asarray, motion)))
    rng = np.random.default_rng(1)
    turned = np.swapaxes(sensor.R_base_sensor, 1, 2)
    felt = np.einsum("tij,tj->ti", turned, sensor.linear_acceleration - robot.gravity)
    turning = np.einsum("tij,tj->ti", turned, sensor.angular_velocity)
    quaternion = quaternions_of(body.R_base_sensor)
    quaternion[rng.random(len(t)) < 0.3] *= -1  # both signs are the same orientation
    return {
        "log": {name: np.array(getattr(truth, name)) for name in ("t", "q", "dq", "wrench")},
        "bias": np.array(truth.bias),
        "quaternion_wxyz": quaternion + 5e-5 * rng.normal(size=quaternion.shape),
        "position": body.p_base_sensor + 1e-4 * rng.normal(size=(len(t), 3)),
        "angular_velocity": turning + 2e-3 * rng.normal(size=(len(t), 3)),
        "specific_force": felt + 0.02 * rng.normal(size=(len(t), 3)),
    }


@pytest.fixture(scope="module")
def by_joints(truth, tmp_path_factory):
    path = tmp_path_factory.mktemp("joints") / "log.npz"
    np.savez(path, **truth["log"])
    setup = parse_setup(ARM)
    log = read_log(path, setup)
    return by_params.filter_with_params(params_for_log.params_for_log(setup, samples_from_log(log)), log)


def filter_pose(folder, setup, truth, **arrays):
    np.savez(folder / "log.npz", t=truth["log"]["t"], wrench=truth["log"]["wrench"], **arrays)
    return filter_file(open_log(folder / "log.npz", setup), setup, folder / "out.npz"), load_npz(folder / "out.npz")


def assert_as_good(result, truth, by_joints, factor=2.0):
    """The bias is right within its error bars, and about as precise as from joints."""
    late = result["t"] > 1
    error = (result["bias"] - truth["bias"])[late]
    assert (np.abs(error) < 5 * result["bias_std"][late]).all()
    by_joint = (by_joints.bias - truth["bias"])[late]
    assert (np.sqrt((error**2).mean(0)) < factor * np.sqrt((by_joint**2).mean(0))).all()


@pytest.mark.slow
def test_orientation_and_position(truth, by_joints, tmp_path):
    setup = pose_setup(orientation="quaternion_wxyz", orientation_noise_std=1e-4, position_noise_std=1e-4)
    arrays = {"orientation": truth["quaternion_wxyz"], "position": truth["position"]}
    outcome, result = filter_pose(tmp_path, setup, truth, **arrays)
    assert outcome.repairs == ()
    # Positions of 0.1 mm without velocities determine the acceleration less well than encoders do.
    assert_as_good(result, truth, by_joints, 10)


def test_an_imu_instead_of_a_position(truth, by_joints, tmp_path):
    setup = pose_setup(
        orientation="quaternion_wxyz",
        linear="specific_force",
        angular_velocity_noise_std=2e-3,
        linear_velocity_noise_std=1e-3,
    )
    arrays = {name: truth[name] for name in ("angular_velocity", "specific_force")}
    _, result = filter_pose(tmp_path, setup, truth, orientation=truth["quaternion_wxyz"], **arrays)
    assert_as_good(result, truth, by_joints, 4)


def test_orientation_alone(truth, tmp_path):
    """Unrecorded accelerations change the bias by no more than the force that they cause."""
    setup = pose_setup(orientation="quaternion_wxyz", linear="none", acceleration_std=1.0)
    outcome, result = filter_pose(tmp_path, setup, truth, orientation=truth["quaternion_wxyz"])
    error = (result["bias"] - truth["bias"])[result["t"] > 1]
    unseen = truth["specific_force"].std() * 0.7
    assert np.sqrt((error[:, :3] ** 2).mean()) < 0.2 * unseen
    assert outcome.summary.mean_nis < 1.5  # their remainder is in the noise


def test_missing_orientations_cost_accuracy_and_nothing_else(truth, tmp_path):
    quaternion = truth["quaternion_wxyz"].copy()
    quaternion[1000:1100] = np.nan
    quaternion[2000:2050] = 0  # as recorders write unknown values
    quaternion[3000:3050, 1] = np.nan
    quaternion[4000:4100] *= 1.01
    setup = pose_setup(orientation="quaternion_wxyz")
    _, result = filter_pose(tmp_path, setup, truth, orientation=quaternion, position=truth["position"])
    assert np.isfinite(result["bias"]).all()
    error = np.abs(result["bias"] - truth["bias"]) / result["bias_std"]
    assert error[200:].max() < 6


@pytest.mark.slow
def test_accelerations_that_go_with_the_turning_are_not_taken_for_weight(truth):
    """Only orientations are recorded, while the arm swings the sensor at an unknown distance."""
    setup = pose_setup(orientation="quaternion_wxyz", linear="none", orientation_noise_std=1e-4, acceleration_std=0.5)
    light = replace(setup, tool=replace(setup.tool, mass=0.5))
    arrays = {"t": truth["log"]["t"], "wrench": truth["log"]["wrench"], "orientation": truth["quaternion_wxyz"]}
    log = ft.Log.from_arrays(light, q=None, **arrays)
    found = ft.identify_tool(light, log, unchecked=True)
    assert abs(found.tool.values[0] - 0.7) < 3 * found.tool.stderr[0] < 0.005
    np.testing.assert_allclose(found.tool.values[1:4], [0.01, 0.0, 0.06], atol=5e-4)
    # With the written setup the filter then knows most of the accelerations.
    again = parse_setup(tomllib.loads(dump_setup(found.setup)))
    np.testing.assert_allclose(again.pose.turns_about, -found.tool.lever, rtol=1e-6)
    rest = ft.filter_log(replace(again, pose=replace(again.pose, turns_about=np.zeros(3))), log)
    left = [np.nanvar(result.innovation[:, 2]) - 0.1**2 for result in (ft.filter_log(again, log), rest)]
    assert left[0] < 0.3 * left[1]
