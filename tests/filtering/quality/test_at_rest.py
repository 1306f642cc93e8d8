"""A tool of unknown weight: logs that do not turn it are filtered, and the consequence is reported."""

import made_weights as made
import numpy as np
import pytest

import ftbias_jax as ft
from ftbias_jax.errors import LogError, SetupError
from ftbias_jax.filtering.quality.at_rest import motion_of, require_motion, rest_in_words, weight_in_bias
from ftbias_jax.io.cleaning import slices
from ftbias_jax.io.log import Log
from ftbias_jax.setup.robots import built_in_robot

SENSOR = {"noise_std": [0.05, 0.002]}
UNKNOWN = ft.parse_setup({"robot": {"model": "ur5e"}, "sensor": SENSOR})
POSE = np.array([0.3, -1.2, 1.5, -1.8, -1.5, 0.2])


def log_of(q, push=0.0):
    turned = made.rotations(built_in_robot("ur5e"), q)
    wrench = made.readings(turned, seed=3)
    wrench[len(q) // 2 :, 2] += push
    return Log.from_arrays(UNKNOWN, np.arange(len(q)) / 50.0, q, wrench)


@pytest.mark.slow
def test_at_rest_the_bias_has_the_weight_and_a_push_is_seen():
    log = log_of(np.tile(POSE, (400, 1)), push=8.0)
    result = ft.filter_log(UNKNOWN, log)
    turned = made.rotations(built_in_robot("ur5e"), POSE[None])
    weight = made.readings(turned, noise=0.0)[0] + made.BIAS
    before = result.t < log.t[200] - 0.1
    np.testing.assert_allclose(result.bias[before][-1], made.BIAS - weight, atol=0.06)
    assert not result.wrench_tool.any()
    pushed = result.wrench_unbiased[(result.t > log.t[201]) & (result.t < log.t[230]), 2]
    assert abs(np.median(pushed) - 8.0) < 0.3
    (told,) = (repair for repair in result.repairs if "tool.mass" in repair.what)
    assert "tool.mass and tool.center_of_mass not stated" in told.what
    assert "part of the bias" in told.what
    assert "accelerations" not in told.what
    assert not told.lost


def test_what_a_log_can_show_is_said_by_its_motion():
    rest, spin = np.tile(POSE, (400, 1)), np.tile(POSE, (400, 1))
    spin[:, 0] += np.linspace(0, 2, 400)
    assert rest_in_words(UNKNOWN, slices(log_of(rest))).startswith("at rest: only bias and noise can be estimated")
    assert "turns by only 0 degrees" in rest_in_words(UNKNOWN, slices(log_of(spin)))
    turning = Log.from_arrays(UNKNOWN, *made.arm_log("ur5e", samples=400))
    assert rest_in_words(UNKNOWN, slices(turning)) == ""
    require_motion(UNKNOWN, turning)
    with pytest.raises(LogError, match=r"log\.npz: q: is of an arm at rest: .*turn the sensor"):
        require_motion(UNKNOWN, log_of(rest), "log.npz")
    with pytest.raises(LogError, match="nothing of the tool"):
        ft.identify_tool(UNKNOWN, log_of(rest))


def test_a_log_at_rest_is_diagnosed_without_a_tool_and_says_what_it_cannot_show():
    found = ft.diagnose(UNKNOWN, [log_of(np.tile(POSE, (1000, 1)))])
    assert found.verdict in ("none", "explained")
    assert "\nAt rest: only bias and noise" in str(found)
    assert "part of the bias" in found.repairs[0][-1].what


def test_a_log_that_turns_the_sensor_needs_the_tool():
    t, q, wrench = made.arm_log("ur5e", samples=100)
    log = Log.from_arrays(UNKNOWN, t, q, wrench)
    with pytest.raises(SetupError, match=r"tool\.mass: is not stated .*ftbias identify LOG"):
        weight_in_bias(UNKNOWN, slices(log))
    stated = ft.parse_setup(
        {"robot": {"model": "ur5e"}, "sensor": SENSOR, "tool": {"mass": 1.0, "center_of_mass": [0, 0, 0.1]}}
    )
    assert weight_in_bias(stated, slices(log)) == (stated, ())


def test_a_mass_without_its_centre_is_not_enough_to_predict_anything():
    setup = ft.parse_setup({"robot": {"model": "ur5e"}, "sensor": SENSOR, "tool": {"mass": 1.0}})
    changed, (told,) = weight_in_bias(setup, slices(log_of(np.tile(POSE, (100, 1)))))
    assert told.what.startswith("tool.center_of_mass not stated")
    assert changed.sensor.compensated == "tool"
    assert (changed.bias.initial_std > 9).all()


def test_how_far_the_sensor_turns_is_that_of_gravity_in_its_axes():
    """Turning about gravity does not change the weight, but causes accelerations."""
    spin = np.tile(POSE, (200, 1))
    spin[:, 0] += np.linspace(0, 2, 200)
    motion = motion_of(UNKNOWN, slices(log_of(spin)))
    assert motion.turn < 1e-9
    assert motion.travel == pytest.approx(2)
    _, (told,) = weight_in_bias(UNKNOWN, slices(log_of(spin)))
    assert "accelerations stay in the wrench and may be taken for contact" in told.what
    q = np.tile(POSE, (500, 1))
    q[:, 3] += 0.2 * np.sin(np.linspace(0, 20, 500))
    motion = motion_of(UNKNOWN, slices(log_of(q)))
    down = np.einsum("tji,j->ti", made.rotations(built_in_robot("ur5e"), q), made.GRAVITY)
    off = np.linalg.norm(down - down.mean(0), axis=1)
    assert motion.turn == pytest.approx(np.sqrt((off**2).mean()) / 9.81, rel=1e-6)
    assert motion.most == pytest.approx(off.max(), rel=1e-6)


def test_joints_that_never_share_a_row_promise_nothing():
    log = log_of(np.tile(POSE, (100, 1)))
    q = log.q.copy()
    q[::2, 0], q[1::2, 1] = np.nan, np.nan
    with pytest.raises(SetupError, match="is not stated"):
        weight_in_bias(UNKNOWN, slices(log._replace(q=q)))
