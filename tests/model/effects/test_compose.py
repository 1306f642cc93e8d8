import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.catalogue import CATALOGUE, typical_values
from ftbias_jax.model.effects.kinematics import subtract_offsets
from ftbias_jax.model.effects.types import motion_of

PREDICTING = [name for name, effect in CATALOGUE.items() if effect.hook != "record"]

predict = jax.jit(compose.predict)


def test_a_motion_worked_out_before_is_the_motion(signals):
    """With effects that use the motion, and with derivatives; another joint offset gives another motion."""
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

    # A jump of the bias is not multiplied by the gain, and appears later by the delay.
    np.testing.assert_allclose(only("gain", "bias_jump") - only("gain"), only("bias_jump") - only(), atol=1e-12)
    late = values["bias_jump"]["time"] + values["time_delay"]["delay"]
    changed = jnp.abs(only("time_delay", "bias_jump") - only("time_delay")).max(1) > 1e-6
    assert signals.t[jnp.argmax(changed)] == pytest.approx(float(late), abs=0.02)
    # The mounting turns what a gain then scales, not the other way round.
    turned = only("mount_rotation")
    np.testing.assert_allclose(only("gain", "mount_rotation"), turned * values["gain"]["gain"][None])


def test_single_precision_goes_through(signals):
    single = jax.tree.map(lambda x: x.astype(jnp.float32), signals)
    names = [name for name in PREDICTING if name != "contact"]
    values = {name: typical_values(CATALOGUE[name], single.model) for name in names}
    reading = predict(single, values)
    assert reading.dtype == jnp.float32
    double = predict(signals, jax.tree.map(lambda x: x.astype(jnp.float64), values))
    # Where a jump is late by a fraction of a sample, the precision of the stamps matters.
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
