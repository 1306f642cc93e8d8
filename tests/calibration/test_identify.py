"""Tools found again in simulated logs: with a turned sensor, with tilted gravity, and from an uninformative log."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.calibration import identify
from ftbias_jax.model import simulate
from ftbias_jax.model.kinematics.screws import rotation_from_vector
from ftbias_jax.model.wrench.inertia import about_center_of_mass, pseudo_inertia
from ftbias_jax.model.wrench.tool_wrench import tool_parameters
from ftbias_jax.setup.rotations import vector_from_rotation
from ftbias_jax.types import Sample

COUNT, DT = 2000, 0.01
TURN = np.array([0.05, -0.08, 0.1])  # rad, rotation vector
TILT = np.array([0.03, -0.02, 0.01])


@pytest.fixture(scope="module")
def truth(params):
    """The small arm with good encoders; its bias moves slowly."""
    joint = params.joint._replace(process_density=jnp.full(3, 5.0))
    bias = params.bias._replace(
        density=jnp.repeat(jnp.array([2e-3, 1e-4]), 3),
        data_variance=None,
        wrench_variance=jnp.repeat(jnp.array([0.1, 0.004]), 3) ** 2,
    )
    return params._replace(joint=joint, bias=bias)


def log_of(params, speed=1.0, seed=0):
    """Every joint swings with two sines; speed 0 is a robot at rest."""
    t = DT * jnp.arange(COUNT)
    phase = jnp.array([0.0, 1.0, 2.0])[None] + speed * t[:, None] * jnp.array([[1.3, 1.7, 2.1]])
    size = jnp.array([[1.0, 0.3, 1.0]])
    q = size * (jnp.sin(phase) + 0.3 * jnp.sin(2.7 * phase))
    rate = speed * jnp.array([[1.3, 1.7, 2.1]])
    dq = size * rate * (jnp.cos(phase) + 0.81 * jnp.cos(2.7 * phase))
    ddq = -size * rate**2 * (jnp.sin(phase) + 0.3 * 2.7**2 * jnp.sin(2.7 * phase))
    made = simulate.simulate(jax.random.key(seed), params, simulate.Trajectory(t, q, dq, ddq))
    return Sample(jnp.diff(t, prepend=t[:1]), made.q, made.dq, made.wrench)


def sheet(theta):
    """Return (10,) mass, centre of mass, and inertia about it."""
    mass, center, inertia = about_center_of_mass(theta)
    return np.concatenate([mass[None], center, inertia])


def with_light_tool(params):
    """What a person states who knows nothing of the tool: 0.1 kg at the sensor's origin."""
    return params._replace(theta=tool_parameters(jnp.array(0.1), jnp.zeros(3), jnp.zeros(6)))


def check_tool(found, truth):
    miss = np.abs(found.values - sheet(truth.theta))
    assert found.converged
    assert found.gain > 100
    assert (miss < 4 * found.stderr).all()
    assert miss[0] < 0.005 * sheet(truth.theta)[0]
    assert (miss[1:4] < 1e-3).all()
    assert (np.linalg.eigvalsh(pseudo_inertia(jnp.asarray(found.theta))) > 0).all()


def test_a_tool_that_was_never_measured(truth):
    found = identify.identify(with_light_tool(truth), log_of(truth))
    check_tool(found, truth)
    np.testing.assert_allclose(found.values, sheet(found.theta), rtol=1e-12)
    assert found.unexcited == []
    assert found.remarks == ("",) * 10
    assert 0.9 < found.excess < 1.5  # the stated tool is light, so the errors of the joints count for little
    assert found.condition < 1e3
    np.testing.assert_allclose(found.rotation, 0, atol=1e-6)
    np.testing.assert_allclose(found.gravity, truth.gravity, rtol=1e-6)


def test_a_sensor_that_is_turned_and_gravity_that_is_tilted(truth):
    """Both are fitted jointly with the tool, from a setup that states neither."""
    turned = truth.arm._replace(zero_rotation=truth.arm.zero_rotation @ rotation_from_vector(jnp.asarray(TURN)))
    gravity = rotation_from_vector(jnp.asarray(TILT)) @ truth.gravity
    there = truth._replace(arm=turned, gravity=gravity)
    found = identify.identify(with_light_tool(truth), log_of(there), mounting=True, gravity=True)
    check_tool(found, there)
    assert found.unexcited == []
    assert (np.abs(found.rotation - TURN) < 4 * found.rotation_stderr).all()
    assert (found.rotation_stderr < 0.01).all()
    assert (np.abs(found.gravity - np.asarray(gravity)) < 4 * found.gravity_stderr + 1e-9).all()
    np.testing.assert_allclose(np.linalg.norm(found.gravity), np.linalg.norm(truth.gravity), rtol=1e-12)


def test_a_sensor_that_is_mounted_upside_down(truth):
    """The sensor is turned by slightly more than half a turn, which no search from the stated axes finds."""
    there = rotation_from_vector(jnp.asarray(TURN)) @ rotation_from_vector(jnp.array([jnp.pi, 0.0, 0.0]))
    turned = truth.arm._replace(zero_rotation=truth.arm.zero_rotation @ there)
    found = identify.identify(with_light_tool(truth), log_of(truth._replace(arm=turned)), mounting=True)
    check_tool(found, truth)
    assert np.linalg.norm(found.rotation) <= np.pi
    miss = vector_from_rotation(np.asarray(there).T @ rotation_from_vector(jnp.asarray(found.rotation)))
    assert (np.abs(miss) < 4 * found.rotation_stderr).all()


@pytest.mark.parametrize("mounting", [False, True])
def test_a_sensor_that_is_not_where_it_is_stated(truth, mounting):
    """Without its place, the missing centimetres are part of the inertia, and the error bars do not contain that."""
    wanted = np.array([0.02, -0.03, 0.05])  # m, sensor axes
    R = np.asarray(truth.arm.zero_rotation)
    moved = truth._replace(arm=truth.arm._replace(zero_position=truth.arm.zero_position - R @ wanted))
    start = with_light_tool(moved)
    if mounting:  # by a quarter turn too: the lever arm is reported in the axes of the stated sensor
        quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        start, wanted = start._replace(arm=start.arm._replace(zero_rotation=R @ quarter.T)), quarter @ wanted
    log = log_of(truth)
    found = identify.identify(start, log, mounting=mounting, translation=True)
    check_tool(found, truth)
    assert found.has_lever
    assert (np.abs(found.lever - wanted) < 4 * found.lever_stderr).all()
    assert (found.lever_stderr < 2e-3).all()
    assert (found.model_stderr > 0).all()
    if not mounting:
        without = identify.identify(start, log)
        assert (np.abs(without.values - sheet(truth.theta)) > 5 * without.stderr).any()
        assert not without.model_stderr.any()


def test_a_robot_that_stands_still_says_nothing_about_inertia(truth):
    """In a single pose a bias of any size explains all of gravity."""
    start = truth._replace(
        theta=tool_parameters(jnp.array(0.5), jnp.zeros(3), jnp.zeros(6)),
        bias=truth.bias._replace(prior_std=1e3 * truth.bias.prior_std),
    )
    found = identify.identify(start, log_of(truth, speed=0.0), mounting=True, gravity=True)
    # The centre of mass is left out: the encoders' noise mimics a little motion.
    assert set(found.unexcited) >= {"mass", *identify.NAMES[4:]}
    assert (found.rotation_stderr > 0.05).all()
    assert (np.abs(found.rotation) < 4 * found.rotation_stderr).all()
    assert any(name.startswith("gravity along") for name in found.unexcited)
    assert found.condition > 1e3
    np.testing.assert_array_equal(found.values[[0, *range(4, 10)]], [0.5, *[0.0] * 6])
    assert found.remarks[0] == identify.KEPT
    assert set(found.remarks[4:]) == {identify.KEPT}
    assert np.isnan(found.stderr[4:]).all()


def test_a_point_mass_stays_one_without_round_off(truth):
    point = tool_parameters(jnp.array(1.3), jnp.array([0.0102, -0.0049, 0.06]), jnp.zeros(6))
    found = identify.identify(truth._replace(theta=point), log_of(truth, speed=0.0))
    assert set(found.remarks[4:]) == {identify.KEPT}
    np.testing.assert_array_equal(found.values[4:], 0.0)


def test_a_bias_that_may_jump_leaves_the_tool_as_it_is(truth):
    """The sensor is set to zero half-way: with its time stated, the tool is found as if it had not been."""
    samples = log_of(truth)
    wrench = samples.wrench.at[COUNT // 2 :].add(jnp.array([0.0, 30.0, -50.0, 1.0, 0.0, 2.0]))
    zeroed = jnp.zeros(COUNT).at[COUNT // 2].set(1.0)
    found = identify.identify(with_light_tool(truth), samples._replace(wrench=wrench, rezeroed=zeroed))
    check_tool(found, truth)
    assert np.nanstd(found.left[: COUNT // 2, 2]) < 1
