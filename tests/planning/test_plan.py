import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ftbias_jax as ft
from ftbias_jax.calibration.tool.physical import NAMES
from ftbias_jax.diagnosis.problem import make_problem
from ftbias_jax.errors import UsageError
from ftbias_jax.model.kinematics.screws import sensor_pose
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.model.simulate import simulate
from ftbias_jax.model.trajectories import Trajectory
from ftbias_jax.planning import climb, plan
from ftbias_jax.planning.forecast import information_of_logs, stds_of
from ftbias_jax.planning.shape import motion_at, random_shapes, within

TABLES = {
    "robot": {"model": "panda"},
    "sensor": {"translation": [0.0, 0.0, 0.04], "noise_std": [0.1, 0.004]},
    "tool": {"mass": 0.9, "center_of_mass": [0.01, 0.0, 0.06], "inertia": [2e-3, 0, 0, 2e-3, 0, 1e-3]},
    "joints": {"process_noise_density": 1.0},
    "limits": {"floor": 0.25, "keep_angle": 1.2, "velocity": [1.5], "jerk": [30.0]},
}
DURATION, RATE, MARGIN = 8.0, 200.0, 0.1


def log_of(setup, motion, seed=0):
    """A log of a motion, with the noise of the setup."""
    made = simulate(jax.random.key(seed), params_from_setup(setup), Trajectory(*map(jnp.asarray, motion[:4])))
    return ft.Log.from_arrays(
        setup, np.asarray(made.t), np.asarray(made.q), np.asarray(made.wrench), np.asarray(made.dq)
    )


@pytest.fixture(scope="module")
def setup():
    return ft.parse_setup(TABLES)


@pytest.fixture(scope="module")
def made(setup):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(climb, "CALLS", 4)
        yield ft.plan(setup, "tool", duration=DURATION, rate=RATE, margin=MARGIN, seed=1)


@pytest.fixture(scope="module")
def positions(setup, made):
    """Rotations and positions of the sensor along the motion."""
    return jax.vmap(lambda q: sensor_pose(params_from_setup(setup).arm, q))(jnp.asarray(made.motion.q))


def test_joints_keep_to_their_limits_and_use_them(setup, made):
    t, q, dq, ddq, jerk = made.motion
    assert len(t) == DURATION * RATE + 1
    lower, upper = setup.robot.position_limits.T
    assert np.all((lower < q) & (q < upper))
    for moving, most in ((dq, 1.5), (ddq, 3.0), (jerk, 30.0)):
        assert np.abs(moving).max() <= (1 - MARGIN) * most
    assert made.used[1:].max(0).min() > 0.5, "every joint moves as it may"
    assert made.used.max() <= 1 - MARGIN + 1e-9
    np.testing.assert_allclose([q[0], q[-1]], [plan.first_pose(setup, (), None)] * 2, atol=1e-12)


def test_no_point_is_below_the_floor_and_the_axis_keeps_its_direction(made, positions):
    rotation, position = (np.asarray(x) for x in positions)
    for point in ([0, 0, -0.04], [0, 0, 0], [0.01, 0, 0.06]):
        assert (position + rotation @ point)[:, 2].min() >= 0.25
    cosine = rotation[:, :, 2] @ rotation[0, :, 2]
    assert cosine.min() >= np.cos(1.2 * (1 - MARGIN)) - 1e-9
    assert cosine.min() < np.cos(0.5), "it turns the wrist"


def test_the_forecast_is_what_a_log_of_the_motion_tells(setup, made):
    """Computed differently: from smoothed joints of a simulated log and the filter's recursion."""
    (asked,), problem = made.asked, make_problem(setup, [log_of(setup, made.motion)])[0]
    told = information_of_logs(problem, ("tool",), ((asked.base, asked.scale, asked.at),))
    ratio = stds_of(told, asked) / made.forecast.plan
    assert made.forecast.labels == NAMES
    assert np.all((ratio > 0.85) & (ratio < 1.15)), ratio


def test_it_tells_more_than_random_motions_within_the_same_limits(setup, made):
    params, start = params_from_setup(setup), made.motion.q[0]
    limits, _ = plan.limits_of(setup, start, MARGIN)
    (asked,), scale = made.asked, made.asked[0].scale
    task, _ = plan.make_task(setup, params, limits, start, ((asked.base, asked.scale, asked.at),), DURATION, RATE)
    count = (task.points.basis.shape[2] - 1) // 2
    errors = []
    for free in random_shapes(5, 20, 7, count):
        coefficients = np.asarray(within(task.points, limits, start, jnp.asarray(free))[0])
        told = climb.information_of(task, coefficients, ("tool",), ft.CATALOGUE)
        errors.append(np.exp(np.log(stds_of(told, asked) / scale).mean()))
    best = np.exp(np.log(made.forecast.plan / scale).mean())
    assert best < 0.67 * min(errors)


def test_a_log_at_hand_adds_what_it_tells(setup, made):
    log = log_of(setup, motion_at(made.motion.t, DURATION, made.motion.q[0], np.zeros((7, 3))))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(climb, "CALLS", 1)
        both = ft.plan(setup, "tool", duration=DURATION, rate=RATE, logs=[log])
    told = both.forecast
    np.testing.assert_allclose(both.motion.q[0], log.q[0])
    assert (np.nan_to_num(told.logs, nan=np.inf) > 10 * told.plan).all(), (
        "a log of an arm at rest tells next to nothing"
    )
    np.testing.assert_allclose(told.together, told.plan, rtol=0.05)
    assert "logs at hand" in str(both)


def test_a_motion_for_the_noise_tells_that_at_rest_and_what_each_speed_adds():
    still = {"position_noise_std": 1e-9, "velocity_noise_std": 1e-9, "process_noise_density": 1e-3}
    growth = {"variance": [[0.02] * 3 + [4e-5] * 3]}
    setup = ft.parse_setup({**TABLES, "joints": still, "effects": {"vibration": growth}})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(climb, "CALLS", 2)
        made = ft.plan(setup, "noise", duration=DURATION, rate=RATE, seed=1)
    std = dict(zip(made.forecast.labels, made.forecast.plan, strict=True))
    level, of_speed = np.repeat([1e-2, 1.6e-5], 3), np.repeat([0.02, 4e-5], 3)
    each = made.motion.dq[:-1, :, None] ** 2 * of_speed
    whole = level + each.sum(1)
    shares = np.concatenate([np.eye(6)[:, None] * level / whole, (each / whole[:, None]).transpose(1, 0, 2)])
    told = 2 * np.einsum("pta,qta->pq", shares, shares)  # d log variance = 2 share d log std
    np.testing.assert_allclose([*std.values()], np.sqrt(np.diag(np.linalg.inv(told))), rtol=0.03)
    assert list(std)[5:7] == ["at_rest_tz", "speed_of_joint_1"]
    assert max(std.values()) < 0.15


@pytest.mark.slow
def test_two_effects_are_compared_where_they_come_nearest_to_one_another(setup):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(climb, "CALLS", 1)
        values = {"time_delay": {"delay": 0.02}, "low_pass": {"cutoff": 4.0}}
        made = ft.plan(setup, "time_delay:low_pass", duration=DURATION, rate=RATE, values=values)
        limits, _ = plan.limits_of(setup, made.motion.q[0], MARGIN)
        numbers = (*((a.base, a.scale, a.at, a.at) for a in made.asked), np.zeros(6))
        arguments = (limits, made.motion.q[0], numbers, DURATION, RATE)
        task, _ = plan.make_task(setup, params_from_setup(setup), *arguments)
        found = climb.with_nearest(task, made.coefficients, ("time_delay", "low_pass"), ft.CATALOGUE)
    (*_, delay), (*_, cutoff), _ = found.numbers
    assert 2 * np.pi * cutoff[0] * 0.02 == pytest.approx(1, rel=0.2), "a delay looks like a low-pass of that time"
    assert 2 * np.pi * 4.0 * delay[0] == pytest.approx(1, rel=0.2)
    assert 12.5 < made.forecast.separates["time_delay:low_pass"] < np.inf


def test_what_is_written_is_what_the_plan_says(made, tmp_path):
    made.save(tmp_path / "motion.csv")
    made.to_json(tmp_path / "plan.json")
    table = np.genfromtxt(tmp_path / "motion.csv", delimiter=",", names=True)
    assert table.dtype.names[:2] + table.dtype.names[-1:] == ("t", "q0", "ddq6")
    np.testing.assert_array_equal(table["dq3"], made.motion.dq[:, 3])
    plain = json.loads((tmp_path / "plan.json").read_text())
    assert plain["expected_std"]["mass"] == made.forecast.plan[0]
    assert plain["from_log_std"] is None
    assert 0.5 < plain["limits"]["largest_share"]["velocity"] <= 1 - MARGIN
    assert "collisions of the arm with itself" in plain["limits"]["not_known"]


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"to_find": "tool:gain"}, "for: got 'tool:gain' (give 'tool', 'noise', an effect, or two"),
        ({"duration": 1.0}, "duration: must be from 4 to 300, not 1"),
        ({"start": [0.0, 1.0]}, "start: has 2 numbers for 7 joints"),
        ({"start": [0.0, 1.9, 0.0, -2.0, 0.0, 1.8, 0.8]}, "panda_joint2 at 1.9 is outside of"),
        ({"start": [0.0, 1.2, 0.0, -1.0, 0.0, 1.8, 0.8]}, "start: the first pose is outside of the limit on floor"),
    ],
)
def test_what_cannot_be_planned_is_said(setup, asked, words):
    with pytest.raises(UsageError) as caught:
        ft.plan(setup, **asked)
    assert words in str(caught.value)


def test_it_is_known_at_any_time_and_stands_still_before_and_after(made):
    np.testing.assert_allclose(made.at(made.motion.t[::7]).ddq, made.motion.ddq[::7], atol=1e-9)
    outside = made.at(np.array([-1.0, DURATION + 1]))
    np.testing.assert_allclose(outside.q, made.motion.q[[0, -1]], atol=1e-12)
    np.testing.assert_allclose(outside.dq, 0, atol=1e-9)
