"""Properties of every entry of the catalogue: a new entry gets these tests, and needs one of its own signature.

Values lie within their bounds; neutral values change nothing; derivatives are finite and right; a log simulated with
the effect is diagnosed, and the resulting setup filters the effect away.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.diagnosis.diagnose import diagnose
from ftbias_jax.errors import SetupError
from ftbias_jax.filtering.verbs.from_setup import filter_log
from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.catalogue import CATALOGUE, neutral_values, typical_values, values_from_setup
from ftbias_jax.model.effects.types import Model, Record
from ftbias_jax.model.params import NOISE_LEVEL, params_from_setup
from ftbias_jax.model.simulate_log import simulate
from ftbias_jax.setup import parse_setup

PREDICTING = [name for name, effect in CATALOGUE.items() if effect.hook != "record"]
SMOOTH = [name for name in PREDICTING if not any(parameter.search for parameter in CATALOGUE[name].parameters)]
RECORDING = [name for name, effect in CATALOGUE.items() if effect.hook == "record"]
SETTLED = {"joint", "time", "link"}
"""Parameters that select something: the prediction is piecewise constant in them."""
BACKWARDS = ("cable", "tool_flexibility", "mount_rotation", "low_pass", "time_delay")
"""Effects whose reverse-mode gradients, slow to compile, are checked in every run."""


PARAMETERS = [(name, parameter) for name, effect in CATALOGUE.items() for parameter in effect.parameters]
IDS = [f"{name}.{parameter.name}" for name, parameter in PARAMETERS]


def raw_values(name, model):
    """Typical values as a setup would state them."""
    return {key: np.asarray(value).tolist() for key, value in typical_values(CATALOGUE[name], model).items()}


@pytest.mark.parametrize("name", CATALOGUE)
def test_an_entry_is_complete(name):
    effect = CATALOGUE[name]
    assert effect.name == name
    assert effect.stage in ("tool", "kinematics", "sensor", "bias", "environment", "timing")
    assert effect.hook in ("model", "wrench", "record")
    assert bool(effect.recording) != bool(effect.transform or effect.reading)
    assert all(twin.effect in CATALOGUE or twin.effect == "none" for twin in effect.twins)
    for text in (effect.explanation, effect.remedy, *(parameter.meaning for parameter in effect.parameters)):
        assert text
        assert "\n" not in text


@pytest.mark.parametrize("name", CATALOGUE)
def test_typical_values_are_allowed(name, model):
    raw = raw_values(name, model)
    (checked,) = values_from_setup({name: raw}).values()
    for parameter in CATALOGUE[name].parameters:
        np.testing.assert_array_equal(checked[parameter.name], np.array(raw[parameter.name], float))


@pytest.mark.parametrize(("name", "parameter"), PARAMETERS, ids=IDS)
def test_values_outside_their_bounds_are_refused(name, parameter, model):
    raw = raw_values(name, model)
    like = np.array(raw[parameter.name], float)
    for bad in (parameter.lower - np.abs(parameter.lower) - 1, parameter.upper + np.abs(parameter.upper) + 1, np.nan):
        if np.all(np.isinf(bad)):
            continue
        value = np.broadcast_to(bad, like.shape).tolist()
        with pytest.raises(SetupError) as caught:
            values_from_setup({name: raw | {parameter.name: value}}, "setup.toml")
        assert caught.value.file == "setup.toml"
        assert caught.value.field == f"effects.{name}.{parameter.name}"
        assert f"{np.max(parameter.upper):g}" in caught.value.remedy
        assert f"{np.min(parameter.lower):g}" in caught.value.remedy


@pytest.mark.parametrize(("name", "parameter"), PARAMETERS, ids=IDS)
def test_values_of_another_kind_are_refused(name, parameter, model):
    raw = raw_values(name, model)
    for bad in ("0.1", None, True, [[1.0], [2.0, 3.0]], [], [1.0] * 7, {"x": 1.0}):
        if -1 in parameter.shape and bad == [1.0] * 7 and parameter.shape == (-1,):
            continue
        with pytest.raises(SetupError, match=rf"effects\.{name}\.{parameter.name}"):
            values_from_setup({name: raw | {parameter.name: bad}})
    without = {key: value for key, value in raw.items() if key != parameter.name}
    if parameter.optional:
        assert parameter.name not in values_from_setup({name: without})[name]
    else:
        with pytest.raises(SetupError, match="missing key"):
            values_from_setup({name: without})


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
    """A direction for each parameter that is not a selection, in the parameter's unit."""
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
    # Backlash, slack, half sines and straight lines between samples have corners; if one lies within the step, both
    # derivatives are valid, so a few samples may differ.
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
        chosen = not np.any(parameter.scale)  # a choice of form, which is not fitted
        assert chosen or name not in SMOOTH or jnp.abs(regressor).max() > 1e-4


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n in BACKWARDS else pytest.mark.slow) for n in PREDICTING]
)
def test_gradients_at_zero_strength_are_finite(name, signals, wrench):
    neutral = neutral_values(CATALOGUE[name], signals.model)
    at = {key: jnp.where(jnp.isfinite(value), value, 1e3) for key, value in neutral.items()}
    reading = reading_of(name, signals, wrench)
    gradient = jax.jit(jax.grad(lambda values: jnp.sum(reading(values) ** 2)))(at)
    assert all(jnp.isfinite(x).all() for x in jax.tree.leaves(gradient))


TIMES = 3.0
"""Number of typical departures that a log shows clearly."""
SIX = [3.0, -2.0, 4.0, 0.1, 0.2, -0.16]
CLEAR = {
    "contact": {"force": [[6.0, -3.0, 4.0]], "start": [8.0], "end": [9.5]},
    "encoder_offset": {"joint": 2, "offset": 0.02},
    "bias_jump": {"amplitude": SIX, "time": 8.0, "ramp": 0.0},
    "warmup": {"amplitude": SIX, "tau": 6.0},
    "time_delay": {"delay": 0.03},
    "clock_drift": {"rate": 2000.0, "offset": 0.01},
    "low_pass": {"cutoff": 3.0},
    "cable": {"stiffness": 20.0, "rest_length": 0.3, "anchor": [0.3, -0.5, 0.4], "link": 0.0},
    "stamp_jitter": {"std": 0.01},
    "quantisation": {"step": 4 * np.repeat([0.1, 0.005], 3)},
    "gain": {"gain": [1.06, 1.0, 1.04, 1.0, 0.97, 1.0]},
    "outliers": {"rate": 0.01},
} | {name: {} for name in ("tool_flexibility", "saturation", "noise_level", "vibration", "dropped_samples")}
"""Values of effects for which TIMES typical departures are too small or too large; {} = typical values."""


def clear_values(name, setup):
    """Values of an effect that are clearly visible in a log of 20 s."""
    params = params_from_setup(setup)
    model = Model(params.arm, params.gravity, params.theta)
    neutral, typical = neutral_values(CATALOGUE[name], model), typical_values(CATALOGUE[name], model)
    if name in CLEAR:
        return {key: np.asarray(value).tolist() for key, value in (typical | CLEAR[name]).items()}
    return {key: np.asarray(x + TIMES * (typical[key] - x)).tolist() for key, x in neutral.items()}


@pytest.mark.slow
@pytest.mark.parametrize("name", CATALOGUE)
def test_what_is_simulated_is_found_and_applied_and_then_filtered_away(name):
    setup = parse_setup(SETUP)
    made = simulate(setup, {name: clear_values(name, setup)}, duration=20, rate=125, seed=1)
    diagnosis = diagnose(setup, [made.log])
    first = diagnosis.causes[0]
    assert name in (first.effect, *first.indistinguishable_from)
    fixed = diagnosis.apply(setup)
    if first.effect == NOISE_LEVEL:  # the setup states it as noise of the sensor
        np.testing.assert_allclose(fixed.sensor.noise_std, setup.sensor.noise_std * first.parameters["scale"])
    else:
        assert first.effect in fixed.effects
    result = filter_log(fixed, made.log)
    rows = np.searchsorted(made.truth.t, result.t - 1e-6)  # samples that are left out are missing
    sigmas = (result.bias - made.truth.bias[rows]) / result.bias_std
    assert np.sqrt(np.nanmean(sigmas**2)) < 1.5
