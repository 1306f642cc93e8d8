from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.errors import UsageError
from ftbias_jax.model.kinematics.arm_batch import arm_motion
from ftbias_jax.model.kinematics.screws import sensor_pose
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.planning.limits import RISE, SOFT, check_start, excess, limits_of
from ftbias_jax.setup import parse_setup

TABLES = {
    "robot": {"model": "panda"},
    "sensor": {"translation": [0.0, 0.0, 0.04], "noise_std": [0.1, 0.004]},
    "tool": {"mass": 0.9, "center_of_mass": [0.01, 0.0, 0.06]},
}
START = np.array([0.0, -0.6, 0.0, -2.0, 0.0, 1.8, 0.8])


def setup_with(**limits):
    return parse_setup({**TABLES, "limits": limits})


def test_what_nobody_states_follows_from_the_robots_speed_and_is_said():
    setup = setup_with()
    limits, assumed = limits_of(setup, START, 0.2)
    np.testing.assert_allclose(limits.velocity, 0.8 * setup.robot.velocity_limits)
    np.testing.assert_allclose(limits.acceleration, limits.velocity / RISE)
    assert [words.split(":")[0] for words in assumed] == ["acceleration", "jerk"]


def test_what_is_stated_comes_first():
    limits, assumed = limits_of(setup_with(velocity=[0.5], acceleration=[2.0], jerk=[9.0]), START, 0.0)
    assert (limits.velocity[0], limits.acceleration[0], limits.jerk[0]) == (0.5, 2.0, 9.0)
    assert assumed == ()


def test_an_arm_without_stated_travel_and_speed_stays_near_its_first_pose():
    setup = setup_with()
    robot = replace(setup.robot, position_limits=None, velocity_limits=None)
    limits, assumed = limits_of(replace(setup, robot=robot), START, 0.5)
    np.testing.assert_allclose(limits.upper - START, 0.4)
    np.testing.assert_allclose(limits.velocity, 0.5)
    assert len(assumed) == 4


def test_excess_is_what_a_plain_loop_over_poses_and_points_finds():
    stated = {"box_lower": [0.2, -0.2, 0.1], "box_upper": [0.7, 0.2, 0.9], "floor": 0.4}
    setup = setup_with(**stated, tip=[0.0, 0.05, 0.2], keep_angle=0.3, wrench=[8.0, 1.0])
    limits, _ = limits_of(setup, START, 0.0)
    arm = params_from_setup(setup).arm
    q = START + 0.4 * np.random.default_rng(0).normal(size=(20, 7)) * (np.arange(20) > 0)[:, None]
    load = np.random.default_rng(1).normal(size=(20, 6)) * 5
    zero = jnp.zeros((7, 20))
    found = np.asarray(excess(limits, arm_motion(arm, jnp.asarray(q.T), zero, zero), jnp.asarray(load)))
    up_at_first = np.asarray(sensor_pose(arm, jnp.asarray(START))[0])[:, 2]
    for k in range(20):
        rotation, position = (np.asarray(x) for x in sensor_pose(arm, jnp.asarray(q[k])))
        places = [position + rotation @ p for p in ([0, 0, -0.04], [0, 0, 0], [0.01, 0, 0.06], [0, 0.05, 0.2])]
        outside = max(max((stated["box_lower"] - p).max(), (p - stated["box_upper"]).max()) for p in places)
        below = max(0.4 - p[2] for p in places)
        tilt = np.cos(0.3) - rotation[:, 2] @ up_at_first
        over = (np.abs(load[k]) / [8, 8, 8, 1, 1, 1] - 1).max()
        np.testing.assert_allclose(found[:, k], [outside / SOFT, below / SOFT, tilt / SOFT, over], atol=1e-9)


@pytest.mark.parametrize(
    ("over", "moved", "words"),
    [
        (np.array([-1, 0.5, -1, -1]), 0.0, "start: the first pose is outside of the limit on floor"),
        (np.full(4, -1.0), 4.0, "panda_joint1 at 4 is outside of -2.6"),
    ],
)
def test_a_first_pose_outside_of_the_limits_is_refused(over, moved, words):
    setup = setup_with()
    limits, _ = limits_of(setup, START, 0.1)
    with pytest.raises(UsageError, match=words):
        check_start(limits, START + moved * np.eye(7)[0], setup.robot.joint_names, over)
