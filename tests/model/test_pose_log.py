"""Simulated logs of a sensor's pose: what is recorded is read back as the motion that was simulated."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from stated import pose_setup

import ftbias_jax as ft
from ftbias_jax.io import read_log
from ftbias_jax.model import pose_log, trajectories
from ftbias_jax.model.kinematics.recorded_pose import body_motions
from ftbias_jax.model.params import params_from_setup

LINEAR = ["position", "specific_force", "none"]


@pytest.mark.parametrize("generate", [trajectories.excitation_sines, trajectories.minimum_jerk_moves])
@pytest.mark.parametrize("entries", [4, 7])
def test_a_tumbling_motion_has_unit_quaternions_and_its_own_derivatives(generate, entries):
    t = jnp.arange(400) / 1000
    motion = pose_log.tumbling(generate, jax.random.key(0), t, entries)
    assert motion.q.shape == (400, entries)
    np.testing.assert_allclose(np.linalg.norm(motion.q[:, :4], axis=1), 1, rtol=1e-12)
    np.testing.assert_allclose(np.gradient(motion.q, t, axis=0)[1:-1], motion.dq[1:-1], atol=2e-4)
    np.testing.assert_allclose(np.gradient(motion.dq, t, axis=0)[1:-1], motion.ddq[1:-1], atol=5e-3)


@pytest.mark.parametrize("linear", LINEAR)
@pytest.mark.parametrize("orientation", ["quaternion_xyzw", "quaternion_wxyz", "matrix"])
def test_a_simulated_log_is_read_back_from_its_file(tmp_path, linear, orientation):
    setup = pose_setup(linear=linear, orientation=orientation)
    made = ft.simulate(setup, duration=2, rate=100, seed=1)
    made.save(tmp_path / "log.npz")
    read = read_log(tmp_path / "log.npz", setup)
    np.testing.assert_allclose(read.q, made.log.q, atol=1e-9)
    np.testing.assert_allclose(read.dq, made.log.dq, atol=1e-9)
    np.testing.assert_allclose(read.wrench, made.log.wrench)
    same = np.abs((read.q[:, :4] * made.truth.q[:, :4]).sum(1))
    np.testing.assert_allclose(same, 1, atol=1e-6)
    if linear == "position":
        assert np.abs(read.q[:, 4:] - made.truth.q[:, 4:]).max() < 6e-4


CONVENTIONS = [
    {"conjugate": True, "position_axes": "body"},
    {"orientation": "axis_angle"},
    {"orientation": "rpy"},
    {"linear": "specific_force", "imu_rotation_rpy": [0.1, -0.4, 1.2]},
    {"linear": "specific_force", "gyroscope": False, "orientation": "matrix"},
]


@pytest.mark.parametrize("pose", CONVENTIONS)
def test_a_log_is_saved_in_the_conventions_of_its_setup(tmp_path, pose):
    plain = ft.simulate(pose_setup(linear=pose.get("linear", "position")), duration=2, rate=100, seed=1)
    setup = pose_setup(**pose)
    made = ft.simulate(setup, duration=2, rate=100, seed=1)
    made.save(tmp_path / "log.npz")
    read = read_log(tmp_path / "log.npz", setup)
    np.testing.assert_allclose(read.q, made.log.q, atol=1e-9)
    np.testing.assert_allclose(read.dq, made.log.dq, atol=1e-9)
    np.testing.assert_allclose(np.abs((read.q[:, :4] * plain.log.q[:, :4]).sum(1)), 1, atol=1e-9)
    if "gyroscope" in pose:
        assert "angular_velocity" not in made.recorded
    else:
        np.testing.assert_allclose(made.log.q[:, 4:], plain.log.q[:, 4:], atol=1e-9)


def test_an_accelerometer_feels_the_acceleration_less_gravity():
    setup = pose_setup(linear="specific_force")
    made = ft.simulate(setup, duration=4, rate=200, seed=2)
    velocity = made.log.dq[:, 4:] - made.log.dq[0, 4:]
    np.testing.assert_allclose(velocity, made.truth.dq[:, 4:] - made.truth.dq[0, 4:], atol=2e-3)
    spin = made.recorded["angular_velocity"]
    body = params_from_setup(setup).arm
    motion = body_motions(body, *(jnp.asarray(x).T for x in (made.truth.q, made.truth.dq, made.truth.ddq)))
    exact = np.einsum("jit,jt->ti", motion.sensor_rotation, motion.angular_velocity)
    assert 0.008 < (spin - exact).std() < 0.012


@pytest.mark.parametrize("linear", LINEAR)
def test_a_log_is_replayed(linear):
    setup = pose_setup(linear=linear)
    made = ft.simulate(setup, duration=2, rate=100, seed=3)
    again = ft.simulate(setup, motion=made.log, seed=4)
    np.testing.assert_array_equal(again.truth.t, made.truth.t)
    inner = slice(20, -20)
    np.testing.assert_allclose(again.truth.dq[inner, :4], made.truth.dq[inner, :4], atol=0.02)
    clean = again.truth.wrench_tool[inner] - made.truth.wrench_tool[inner]
    assert (np.abs(clean).mean(0) < [0.3] * 3 + [0.03] * 3).all()


@pytest.mark.parametrize("name", ["encoder_offset", "cable"])
def test_effects_of_joints_are_refused_with_the_reason(name):
    setup = pose_setup()
    typical = {"encoder_offset": {"joint": 2, "offset": 0.01}, "cable": {"stiffness": 10, "rest_length": 0.1}}
    typical["cable"]["anchor"] = [0, 0, 1]
    with pytest.raises(
        ft.UsageError, match=rf"effects: {name}: does not go with \[sensor_pose\]: it acts on the joints"
    ):
        ft.simulate(setup, {name: {}}, duration=1, rate=50)
    with pytest.raises(ft.SetupError, match=rf"effects.{name}: does not go with \[sensor_pose\]"):
        params_from_setup(pose_setup(tables={"effects": {name: typical[name]}}))


def test_noise_grows_with_the_speed_of_turning_and_a_setup_has_one_row_of_it():
    growing = {"vibration": {"variance": [0.5] * 3 + [0.02] * 3, "speed": 0.4}}
    made = ft.simulate(pose_setup(tables={"effects": growing}), duration=20, rate=200, seed=3)
    motion = body_motions(params_from_setup(pose_setup()).arm, made.truth.q.T, made.truth.dq.T, made.truth.ddq.T)
    turning = np.linalg.norm(motion.angular_velocity, axis=0)
    variance = 0.5 * turning**2 / np.sqrt(1 + (turning / 0.4) ** 2)
    noise = (made.log.wrench - made.truth.wrench_clean + made.truth.bias)[:, :3]
    slow, fast = variance < np.median(variance), variance > np.quantile(variance, 0.8)
    for rows in (slow, fast):
        expected = 0.1**2 + variance[rows].mean()
        assert np.square(noise[rows]).mean() == pytest.approx(expected, rel=0.1)
    with pytest.raises(ft.SetupError, match=r"variance: has 7 rows"):
        params_from_setup(pose_setup(tables={"effects": {"vibration": {"variance": [[0.1] * 6] * 7}}}))


def test_an_effect_of_accelerations_needs_them():
    flexible = {"tool_flexibility": {"frequency": 12.0, "damping_ratio": 0.05}}
    with pytest.raises(ft.SetupError, match="the sensor's acceleration is not recorded"):
        params_from_setup(pose_setup(linear="none", tables={"effects": flexible}))
    assert params_from_setup(pose_setup(tables={"effects": flexible})).effects


def test_a_known_effect_is_taken_out_by_the_filter():
    sharp = {"bias": {"initial_std": [1e-3, 1e-4], "initial_drift_std": [1e-5, 1e-6]}}
    setup = pose_setup(tables=sharp)
    effects = {"mount_rotation": {"rotation": [0.1, -0.05, 0.2]}}
    made = ft.simulate(setup, effects, duration=10, rate=100, seed=6)
    knowing = pose_setup(tables={**sharp, "effects": effects})
    rms = [np.sqrt(np.nanmean(ft.filter_log(s, made.log, as_stated=True).innovation ** 2)) for s in (setup, knowing)]
    assert rms[1] < 0.1 < 0.3 < rms[0]
