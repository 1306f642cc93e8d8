from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.catalogue import CATALOGUE, neutral_values, typical_values
from ftbias_jax.model.effects.kinematics import subtract_offsets
from ftbias_jax.model.effects.types import Record, motion_of

PREDICTING = [name for name, effect in CATALOGUE.items() if effect.hook != "record"]
SMOOTH = [name for name in PREDICTING if not any(parameter.search for parameter in CATALOGUE[name].parameters)]
RECORDING = [name for name, effect in CATALOGUE.items() if effect.hook == "record"]
SETTLED = {"joint", "time", "link"}
"""Parameters that select: the prediction is piecewise constant in them."""

predict = jax.jit(compose.predict)


def reading_of(name, signals, wrench):
    """values -> reading with one effect; the kinematics, slow to compile, run only where the effect needs them."""
    if CATALOGUE[name].hook == "model":
        return lambda values: compose.predict(signals, {name: values})
    return lambda values: compose.read(signals, {name: values}, wrench)


@pytest.fixture(scope="module")
def record(signals, wrench):
    noise = 0.1 * jax.random.normal(jax.random.key(3), wrench.shape)
    return Record(signals.t, wrench + noise, noise, signals.dq)


@pytest.mark.parametrize("name", PREDICTING)
def test_zero_strength_changes_nothing_and_typical_strength_does(name, signals, wrench):
    effect = CATALOGUE[name]
    reading = jax.jit(reading_of(name, signals, wrench))
    np.testing.assert_allclose(reading(neutral_values(effect, signals.model)), wrench, atol=1e-12)
    typical = reading(typical_values(effect, signals.model))
    assert jnp.isfinite(typical).all()
    assert jnp.abs(typical - wrench).max() > 1e-4


@pytest.mark.parametrize("name", RECORDING)
def test_zero_strength_leaves_record_and_filter_alone_and_typical_strength_does_not(name, signals, record):
    effect = CATALOGUE[name]
    neutral = {name: neutral_values(effect, signals.model)}
    np.testing.assert_array_equal(compose.correct_record(record.wrench, signals.model, neutral), record.wrench)
    widened = compose.noise_variance(jnp.full(6, 0.01), jnp.ones_like(record.wrench), signals.model, neutral)
    np.testing.assert_allclose(widened, np.full(record.wrench.shape, 0.01))
    run = jax.jit(lambda values: compose.record(jax.random.key(4), record, signals.model, {name: values}))
    jax.tree.map(partial(np.testing.assert_allclose, atol=1e-13), run(neutral[name]), record)
    assert not jnp.array_equal(run(typical_values(effect, signals.model)).wrench, record.wrench)


def tangents(values):
    """A direction for each parameter that is not a selection, in its own unit."""
    rng = np.random.default_rng(5)
    return {
        key: jnp.zeros_like(value) if key in SETTLED else (0.1 + 0.3 * jnp.abs(value)) * rng.normal(size=value.shape)
        for key, value in values.items()
    }


@pytest.mark.parametrize("name", PREDICTING)
def test_the_derivative_is_that_of_finite_differences(name, signals, wrench):
    values = typical_values(CATALOGUE[name], signals.model)
    tangent = tangents(values)
    reading = reading_of(name, signals, wrench)

    def along(step):
        return reading(jax.tree.map(lambda x, d: x + step * d, values, tangent))

    _, derivative = jax.jit(lambda s: jax.jvp(along, (s,), (1.0,)))(0.0)
    step = 1e-5
    difference = jax.jit(lambda: (along(step) - along(-step)) / (2 * step))()
    # Play, slack, half sines and straight lines between samples have corners; where one lies within the step both
    # are right in their way, so a few samples may differ.
    scale = jnp.abs(difference).max()
    differs = (jnp.abs(derivative - difference) > 1e-5 * scale).any(1)
    assert differs.sum() <= (0 if name in SMOOTH and name not in ("hysteresis", "time_delay") else 8)


@pytest.mark.parametrize("name", PREDICTING)
def test_derivatives_at_zero_strength_are_finite_and_a_smooth_effects_are_regressors(name, signals, wrench):
    neutral = neutral_values(CATALOGUE[name], signals.model)
    at = {key: jnp.where(jnp.isfinite(value), value, 1e3) for key, value in neutral.items()}

    @jax.jit
    def column(key_tangent):
        return jax.jvp(reading_of(name, signals, wrench), (at,), (key_tangent,))[1]

    for parameter in CATALOGUE[name].parameters:
        tangent = jax.tree.map(jnp.zeros_like, at)
        tangent[parameter.name] += jnp.asarray(parameter.scale)
        regressor = column(tangent)
        assert jnp.isfinite(regressor).all()
        chosen = not np.any(parameter.scale)  # a choice of form, nothing that is fitted
        assert chosen or name not in SMOOTH or jnp.abs(regressor).max() > 1e-4


@pytest.mark.parametrize("name", ["cable", "tool_flexibility", "mount_rotation", "low_pass", "time_delay"])
def test_gradients_at_zero_strength_are_finite(name, signals, wrench):
    neutral = neutral_values(CATALOGUE[name], signals.model)
    at = {key: jnp.where(jnp.isfinite(value), value, 1e3) for key, value in neutral.items()}
    reading = reading_of(name, signals, wrench)
    gradient = jax.jit(jax.grad(lambda values: jnp.sum(reading(values) ** 2)))(at)
    assert all(jnp.isfinite(x).all() for x in jax.tree.leaves(gradient))


def test_a_motion_worked_out_before_is_the_motion(signals):
    """With effects that look at it, and with its derivatives; another offset of the joints gives another motion."""
    names = ("gravity_tilt", "cable", "contact")
    signals = signals._replace(**{name: getattr(signals, name)[:50] for name in ("t", "q", "dq", "ddq", "temperature")})
    values = {name: typical_values(CATALOGUE[name], signals.model) for name in names}
    values["cable"]["link"] = jnp.array(2.0)

    def direct(offsets):
        return compose.predict(subtract_offsets(offsets, signals), values)

    def apart(offsets):
        moving = motion_of(subtract_offsets(offsets, signals))
        return compose.predict(signals._replace(motion=moving), values)

    at, along = jnp.array([0.1, -0.2, 0.3]), jnp.array([1.0, 2.0, -1.0])
    (expected, slope), (got, got_slope) = (jax.jit(lambda f=f: jax.jvp(f, (at,), (along,)))() for f in (direct, apart))
    np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(got_slope, slope, rtol=1e-10, atol=1e-12 * np.abs(slope).max())
    moved = subtract_offsets(at, signals._replace(motion=motion_of(signals)))
    np.testing.assert_allclose(predict(moved, values), expected, rtol=1e-12, atol=1e-12)


def test_effects_act_in_physical_order_whatever_order_they_are_named_in(signals, wrench):
    names = ("time_delay", "bias_jump", "gain", "mount_rotation", "tool_mass", "low_pass")
    values = {name: typical_values(CATALOGUE[name], signals.model) for name in names}
    backwards = dict(reversed(values.items()))
    np.testing.assert_array_equal(predict(signals, values), predict(signals, backwards))
    read = jax.jit(compose.read)

    def only(*some):
        return read(signals, {name: values[name] for name in some}, wrench)

    # A jump of the bias is not multiplied by the gain, and comes late by the delay.
    np.testing.assert_allclose(only("gain", "bias_jump") - only("gain"), only("bias_jump") - only(), atol=1e-12)
    late = values["bias_jump"]["time"] + values["time_delay"]["delay"]
    changed = jnp.abs(only("time_delay", "bias_jump") - only("time_delay")).max(1) > 1e-6
    assert signals.t[jnp.argmax(changed)] == pytest.approx(float(late), abs=0.02)
    # The mounting turns what a gain then scales, not the other way round.
    turned = only("mount_rotation")
    np.testing.assert_allclose(only("gain", "mount_rotation"), turned * values["gain"]["gain"][None])


def test_predict_maps_over_values(signals):
    mass = jnp.array([0.7, 0.8, 0.9])
    delay = jnp.array([0.0, 0.1, 0.2])
    batch = {"tool_mass": {"mass": mass}, "time_delay": {"delay": delay}}
    many = jax.jit(jax.vmap(compose.predict, (None, 0)))(signals, batch)
    for i in range(3):
        one = predict(signals, {"tool_mass": {"mass": mass[i]}, "time_delay": {"delay": delay[i]}})
        np.testing.assert_allclose(many[i], one, atol=1e-12)


def test_single_precision_goes_through(signals):
    single = jax.tree.map(lambda x: x.astype(jnp.float32), signals)
    names = [name for name in PREDICTING if name != "contact"]
    values = {name: typical_values(CATALOGUE[name], single.model) for name in names}
    reading = predict(single, values)
    assert reading.dtype == jnp.float32
    double = predict(signals, jax.tree.map(lambda x: x.astype(jnp.float64), values))
    # Where a jump is late by a share of a sample, the stamps' own precision shows.
    np.testing.assert_allclose(np.sort(np.abs(reading - double), 0)[:-2], 0, atol=2e-3)


def test_a_catalogue_may_have_another_entry(signals, wrench):
    own = CATALOGUE["gain"]._replace(name="halved", parameters=(), reading=lambda values, signals, wrench: wrench / 2)
    reading = compose.read(signals, {"halved": {}}, wrench, {**CATALOGUE, "halved": own})
    np.testing.assert_allclose(reading, wrench / 2)


def test_the_bias_of_effects_has_the_sign_of_the_report(signals, wrench):
    values = {name: typical_values(CATALOGUE[name], signals.model) for name in ("bias_jump", "gain", "warmup")}
    bias = compose.bias(signals, values)
    without = compose.read(signals, {"gain": values["gain"]}, wrench)
    np.testing.assert_allclose(compose.read(signals, values, wrench), without - bias, atol=1e-12)
    assert (bias[-1] > 0).all()


def test_temperature_gaps_are_bridged():
    t, nan = np.arange(5.0), np.nan
    np.testing.assert_array_equal(compose.fill_temperature(t, np.array([nan, 1, nan, 3, nan])), [1, 1, 2, 3, 3])
    np.testing.assert_array_equal(compose.fill_temperature(t, np.full(5, nan)), np.zeros(5))
