"""How each effect appears in the data, from first principles rather than from the effect's own code.

MuJoCo is the reference for tool, mounting, encoders, crosstalk, cables and contacts: simulators/test_mend_mjcf.py and
validation/generator/test_make.py.
"""

from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.sampling import screen_saturated
from ftbias_jax.model.effects.types import Record
from ftbias_jax.model.kinematics.screws import rotation_from_vector, sensor_pose
from ftbias_jax.model.wrench.tool_wrench import data_matrix

predict = jax.jit(compose.predict)


@pytest.fixture(scope="module")
def R_base_sensor(signals):
    return np.asarray(jax.vmap(lambda q: sensor_pose(signals.model.arm, q)[0])(signals.q))


@pytest.fixture(scope="module")
def at_rest(signals):
    """The same poses, each at rest."""
    return signals._replace(dq=jnp.zeros_like(signals.q), ddq=jnp.zeros_like(signals.q))


def test_more_mass_weighs_more_along_gravity(at_rest, R_base_sensor):
    mass = at_rest.model.theta[0] + 0.1
    change = predict(at_rest, {"tool_mass": {"mass": mass}}) - predict(at_rest, {})
    weight = -0.1 * np.asarray(at_rest.model.gravity) @ R_base_sensor
    np.testing.assert_allclose(change[:, :3], weight, atol=1e-12)
    center = np.asarray(at_rest.model.theta[1:4] / at_rest.model.theta[0])
    np.testing.assert_allclose(change[:, 3:], np.cross(center, weight), atol=1e-12)


def test_tilted_gravity_is_a_force_fixed_in_the_world(at_rest, R_base_sensor):
    gravity = jnp.array([1.4, -2.0, -9.3])
    change = predict(at_rest, {"gravity_tilt": {"gravity": 3 * gravity}}) - predict(at_rest, {})
    in_world = np.einsum("tij,tj->ti", R_base_sensor, change[:, :3])
    size = np.linalg.norm(at_rest.model.gravity)
    tilted = gravity * size / np.linalg.norm(gravity)  # the parameter's length does not matter
    expected = np.asarray(-at_rest.model.theta[0] * (tilted - at_rest.model.gravity))
    np.testing.assert_allclose(in_world, np.tile(expected, (len(in_world), 1)), atol=1e-12)


def test_a_tool_that_turns_with_its_sensor_is_an_arm_with_a_turned_sensor_frame(signals):
    """The tool's parameters belong to the sensor's axes, so only these axes are different."""
    rotation = jnp.array([0.1, -0.2, 0.3])
    turned = predict(signals, {"mount_rotation": {"rotation": rotation, "tool_turns": jnp.array(1.0)}})
    arm = signals.model.arm
    elsewhere = arm._replace(zero_rotation=arm.zero_rotation @ rotation_from_vector(rotation))
    expected = predict(signals._replace(model=signals.model._replace(arm=elsewhere)), {})
    np.testing.assert_allclose(turned, expected, atol=1e-10)


def test_biases_of_effects_lower_the_reading(signals, wrench):
    t, one = np.asarray(signals.t)[:, None], np.ones(6)
    got = compose.read(signals, {"bias_jump": {"time": 4.0, "amplitude": one}}, wrench)
    np.testing.assert_allclose(got - wrench, -np.where(t >= 4, 1.0, 0.0) * one)
    got = compose.read(signals, {"bias_jump": {"time": 4.0, "amplitude": one, "ramp": 2.0}}, wrench)
    np.testing.assert_allclose(wrench - got, np.interp(t, [4, 6], [0, 1]) * one, atol=1e-12)
    got = compose.read(signals, {"warmup": {"tau": 2.0, "amplitude": one}}, wrench)
    np.testing.assert_allclose(got - wrench, -(1 - np.exp(-t / 2)) * one, atol=1e-12)
    got = compose.read(signals, {"temperature_drift": {"per_kelvin": one}}, wrench)
    warmer = np.asarray(signals.temperature - signals.temperature[0])[:, None]
    np.testing.assert_allclose(got - wrench, -warmer * one, atol=1e-12)


def test_a_flexible_tool_sags_under_its_weight(at_rest):
    """At rest, the tool hangs where springs about x and y balance the weight of the turned tool."""
    frequency, pose = 4.0, 100
    at = at_rest._replace(q=jnp.tile(at_rest.q[pose], (len(at_rest.t), 1)))
    rigid = np.asarray(predict(at, {}))[0]
    flexible = predict(at, {"tool_flexibility": {"frequency": frequency, "damping_ratio": 0.05}})[0]
    theta = np.asarray(at.model.theta)
    center, stiffness = theta[1:4] / theta[0], theta[[4, 7]] * (2 * np.pi * frequency) ** 2
    turn = np.zeros(3)
    for _ in range(50):
        torque = np.cross(center + np.cross(turn, center), rigid[:3])
        turn[:2] = -torque[:2] / stiffness
    np.testing.assert_allclose(flexible[:3], rigid[:3], atol=1e-12)
    np.testing.assert_allclose(flexible[3:], torque, atol=1e-2 * np.abs(torque - rigid[3:]).max())
    assert np.abs(torque - rigid[3:]).max() > 0.01


@pytest.mark.parametrize("way", range(6))
def test_a_tool_that_swings_one_way_follows_its_equation_of_motion(signals, way):
    """A share of the tool moves on one spring without sagging; the reference is integrated step by step."""
    frequency, damping_ratio, share, dt = 3.0, 0.1, 0.6, 1e-3
    t = np.arange(0, 1.5, dt)
    ddq = 2 * (1 - np.cos(9 * t))[:, None] * np.ones(3)
    at = signals._replace(t=t, q=np.zeros((len(t), 3)), dq=np.zeros((len(t), 3)), ddq=ddq)
    rigid = np.asarray(predict(at, {}))
    values = {"frequency": frequency, "damping_ratio": damping_ratio, "share": share * np.eye(6)[way], "sagging": 0.0}
    theta, w = np.asarray(at.model.theta), 2 * np.pi * frequency
    unit = np.eye(6)[way]  # unit acceleration along or about the axis
    pushed = np.asarray(data_matrix(unit[:3], np.zeros(3), unit[3:])) @ theta
    moved, rate, swing = -rigid[0, way] / (pushed[way] * w**2), 0.0, np.zeros(len(t))
    for k in range(len(t)):
        swing[k] = -rigid[k, way] / pushed[way] - 2 * damping_ratio * w * rate - w**2 * moved
        rate += dt * swing[k]
        moved += dt * rate
    change = predict(at, {"tool_flexibility": values}) - rigid
    expected = share * swing[:, None] * pushed
    np.testing.assert_allclose(change, expected, atol=0.02 * np.abs(expected).max())
    assert np.abs(expected[:, way]).max() > 0.005 * np.abs(rigid[:, way]).max()


def test_gauges_follow_the_thermometer_with_a_lag(signals, wrench):
    lag, per_kelvin = 1.7, np.arange(1.0, 7)
    t, temperature = np.asarray(signals.t), np.asarray(signals.temperature)
    fine = np.linspace(0, t[-1], 40001)
    step, felt = fine[1], np.full(len(fine), temperature[0])
    recorded_temperature = np.interp(fine, t, temperature)
    for k in range(1, len(fine)):
        felt[k] = felt[k - 1] + step / lag * (recorded_temperature[k - 1] - felt[k - 1])
    got = compose.read(signals, {"temperature_drift": {"per_kelvin": per_kelvin, "lag": lag}}, wrench)
    expected = np.interp(t, fine, felt) - temperature[0]
    np.testing.assert_allclose(wrench - got, expected[:, None] * per_kelvin, atol=2e-3)
    instant = compose.read(signals, {"temperature_drift": {"per_kelvin": per_kelvin, "lag": 0.0}}, wrench)
    assert np.abs(instant - got).max() > 1


def recorded(signals, wrench, **values):
    noise = 0.1 * jax.random.normal(jax.random.key(3), wrench.shape)
    record = Record(signals.t, wrench + noise, noise, signals.dq)
    return noise, compose.record(jax.random.key(4), record, signals.model, values).wrench


def test_noise_has_another_size_and_vibration_adds_a_variance_of_squared_speeds(signals, wrench):
    noise, got = recorded(signals, wrench, noise_level={"scale": jnp.full(6, 3.0)})
    np.testing.assert_allclose(got - wrench, 3 * noise, atol=1e-12)
    rows = jnp.outer(jnp.array([0.5, 1.0, 2.0]), jnp.arange(1.0, 7))
    noise, got = recorded(signals, wrench, vibration={"variance": rows})
    variance = np.einsum("tn,nk->tk", np.asarray(signals.dq) ** 2, rows)
    white = np.asarray(got - wrench - noise) / np.sqrt(variance)
    np.testing.assert_allclose((white**2).mean(0), 1, atol=5 * np.sqrt(2 / len(white)))
    assert abs(np.corrcoef(np.abs(white[:, 0]), variance[:, 0])[0, 1]) < 0.15
    _, for_all = recorded(signals, wrench, vibration={"variance": rows[:1]})
    _, one_by_one = recorded(signals, wrench, vibration={"variance": jnp.broadcast_to(rows[:1], (3, 6))})
    np.testing.assert_array_equal(for_all, one_by_one)


def test_a_limit_does_not_hold_on_a_side_on_which_readings_exceed_it():
    """After a tare, the limits of the two sides differ, and a setup states one."""
    limits, rising = np.array([4.0, 4, 4, 0.2, 0.2, 0.2]), np.linspace(-10, 3, 1001)[:, None] * np.ones(6)
    assert np.isfinite(screen_saturated({"limits": limits}, jnp.asarray(rising.clip(max=-limits)))).all()
    clipped = rising.clip(-2, 2.5)
    clipped[::500] = 50.0  # spikes are no other limit
    left = screen_saturated({"limits": np.full(6, 2.5)}, jnp.asarray(clipped))
    np.testing.assert_array_equal(np.isnan(left), clipped >= 2.5)


def test_saturated_readings_have_flat_tops_and_are_left_out(signals, wrench):
    values = {"saturation": {"limits": np.array([4.0, 4, 4, 0.2, 0.2, 0.2])}}
    _, got = recorded(signals, wrench, **values)
    for channel, limit in enumerate(values["saturation"]["limits"]):
        at_limit = np.abs(got[:, channel]) == limit
        assert np.abs(got[:, channel]).max() == limit
        assert at_limit.sum() > 5
        np.testing.assert_array_equal(
            np.isnan(compose.correct_record(got, signals.model, values))[:, channel], at_limit
        )


def test_quantised_readings_lie_on_a_lattice(signals, wrench):
    step = np.array([0.5, 0.5, 0.5, 0.02, 0.02, 0.0])
    _, got = recorded(signals, wrench, quantisation={"step": step})
    in_steps = np.asarray(got)[:, :5] / step[:5]
    np.testing.assert_allclose(in_steps, np.round(in_steps), atol=1e-9)
    assert len(np.unique(got[:, 5])) == len(got)
    variance = compose.noise_variance(jnp.full(6, 0.01), wrench, signals.model, {"quantisation": {"step": step}})
    np.testing.assert_allclose(variance[0], 0.01 + step**2 / 12)


def test_outliers_are_single_samples_far_off_and_are_left_out(signals, wrench):
    values = {"outliers": {"rate": 0.02, "size": np.full(6, 5.0)}}
    noise, got = recorded(signals, wrench, **values)
    off = np.asarray(got - wrench - noise)
    hit = np.abs(off[:, 0]) > 1
    assert 0.01 < hit.mean() < 0.03
    np.testing.assert_allclose(np.abs(off[hit]), 5, atol=1e-12)
    left_out = np.isnan(compose.correct_record(got, signals.model, values)).all(1)
    neighbours = np.convolve(hit, [1, 0, 1], "same")
    alone = hit & (neighbours == 0)
    alone[[0, -1]] = False  # the ends have one neighbour and are kept
    assert left_out[alone].all()
    assert not left_out[~hit & (neighbours < 2)].any()  # between two spikes a good sample looks like one


def test_the_error_of_jitter_is_the_rate_times_the_jitter(signals, wrench):
    noise, got = recorded(signals, wrench, stamp_jitter={"std": 2e-3})
    rate = np.gradient(np.asarray(wrench), np.asarray(signals.t), axis=0)
    error = np.asarray(got - wrench - noise)
    assert np.sqrt((error**2).mean() / (rate**2).mean()) == pytest.approx(2e-3, rel=0.15)
    widened = compose.noise_variance(
        jnp.full(6, 0.01), jnp.asarray(rate), signals.model, {"stamp_jitter": {"std": 2e-3}}
    )
    np.testing.assert_allclose(widened, 0.01 + (2e-3 * rate) ** 2)


def test_dropped_samples_repeat_the_last_one_or_are_missing(signals, wrench):
    values = {"dropped_samples": {"rate": 0.2, "repeated": 0.5}}
    _, got = recorded(signals, wrench, **values)
    got = np.asarray(got)
    missing = np.isnan(got).all(1)
    rows = got[~missing]
    repeats = np.array([np.array_equal(a, b) for a, b in pairwise(rows)])
    assert 0.05 < missing.mean() < 0.15
    assert 0.05 < repeats.mean() < 0.2
    np.testing.assert_array_equal(np.isnan(got).any(1), missing)
    _, only_repeats = recorded(signals, wrench, dropped_samples={"rate": 0.2})
    left_out = np.isnan(compose.correct_record(only_repeats, signals.model, {"dropped_samples": {"rate": 0.2}})).all(1)
    np.testing.assert_array_equal(left_out[1:], (only_repeats[1:] == only_repeats[:-1]).all(1))
