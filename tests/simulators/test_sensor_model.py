import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.errors import SetupError
from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.model.effects.types import Model, Signals
from ftbias_jax.setup import parse_setup
from ftbias_jax.simulators.sensor_file import load_sensor_model, sensor_model, sensor_text
from ftbias_jax.simulators.sensor_model import EFFECTS, Draws, delayed_by

BIASES = {"noise_density": [2e-3, 1e-4], "initial": [1.0, 0.1], "initial_std": [2.0, 0.2], "drift_time": 50.0}
NOISE = {"noise_std": [0.1, 0.004], "correlated_std": [0.2, 0.01], "correlated_time": 0.3}
LEAK = np.eye(6) + np.diag([0.02, 0.01, 0.0, 0.01, 0.02], 1)
MEAN = {
    "gain": {"gain": [1.02, 0.97, 1.0, 1.0, 1.01, 0.99]},
    "crosstalk": {"matrix": LEAK.tolist()},
    "hysteresis": {"width": [0.3, 0.02]},
    "low_pass": {"cutoff": 8.0},
    "warmup": {"amplitude": [1.0, 0.1], "tau": 2.0},
    "temperature_drift": {"per_kelvin": [0.05, 0.005], "lag": 0.4},
    "bias_jump": {"time": 1.0, "amplitude": [-1.0, 0.2], "ramp": 0.2},
    "time_delay": {"delay": 0.0137},
}
SAMPLES = {
    "stamp_jitter": {"std": 1e-3},
    "noise_level": {"scale": 1.5},
    "vibration": {"variance": [[0.01] * 3 + [1e-4] * 3], "speed": 0.5},
    "saturation": {"limits": [12.0, 1.2]},
    "quantisation": {"step": [0.01, 0.001]},
    "outliers": {"rate": 0.02, "size": [5.0, 0.5]},
    "dropped_samples": {"rate": 0.05, "repeated": 0.5},
}


def model_of(effects, sensor=NOISE, bias=BIASES):
    return sensor_model(parse_setup({"sensor_pose": {}, "sensor": sensor, "bias": bias, "effects": effects}))


def quiet(model):
    """The model without noise and without bias process."""
    nothing = {name: 0 * getattr(model, name) for name in ("noise_std", "density", "initial", "initial_std")}
    return model._replace(**nothing, correlated_std=None, correlated_time=None)


@pytest.fixture(scope="module")
def series():
    rng = np.random.default_rng(0)
    t = np.concatenate([[0.0], np.cumsum(rng.uniform(0.001, 0.004, 999))])  # not a constant rate
    phase = rng.uniform(0, 6, (6,))
    wrench = np.array([9.0] * 3 + [0.5] * 3) * np.sin(np.outer(t, np.arange(3, 9)) + phase)
    dq = np.cos(np.outer(t, np.arange(1, 8)))
    return t, wrench, dq, 25 + 4 * t


def run(model, series, seed=0, xp=np, environments=1):
    """(T, N, 6) readings by a loop over the samples."""
    t, wrench, dq, temperature = (xp.asarray(x) for x in series)
    rng = np.random.default_rng(seed)

    def draws():
        return Draws(*(x if x is None else xp.asarray(x) for x in model.draw(rng, environments)))

    memory = model.memory(0.001)
    felt = xp.broadcast_to(wrench[:, None], (len(t), environments, 6))
    state = model.start(felt[0], draws(), temperature[0], memory)
    readings = []
    step = jax.jit(model.step) if xp is jnp else model.step
    for i in range(1, len(t)):
        speeds = xp.broadcast_to(dq[i], (environments, 7))
        state, reading = step(state, felt[i], t[i] - t[i - 1], draws(), speeds, temperature[i])
        readings.append(reading)
    return xp.stack(readings)


SECOND_ORDER = {"low_pass": {"cutoff": 8.0, "order": 2.0}}


@pytest.mark.parametrize("effects", [{name: MEAN[name]} for name in MEAN] + [SECOND_ORDER, MEAN], ids="-".join)
def test_what_changes_the_mean_is_the_effects_of_the_catalogue(series, effects):
    t, wrench, _, temperature = series
    model = quiet(model_of(effects))
    signals = Signals(*(jnp.asarray(x) for x in (t, t, t, t, temperature)), Model(None, None, jnp.zeros(10)))
    values = {name: {key: jnp.asarray(x) for key, x in model.values[name].items()} for name in effects}
    expected = compose.read(signals, values, jnp.asarray(wrench))[1:]
    np.testing.assert_allclose(run(model, series)[:, 0], expected, rtol=0, atol=1e-12)


def test_numpy_and_jax_agree(series):
    short = tuple(x[:200] for x in series)
    model = model_of(MEAN | SAMPLES)
    readings = run(model, short, environments=3)
    assert 0 < np.isnan(readings).mean() < 0.1
    np.testing.assert_allclose(run(model, short, xp=jnp, environments=3), readings, rtol=0, atol=1e-12)


def test_many_environments_are_each_as_one_alone(series):
    model = model_of(MEAN | SAMPLES)
    wrench = np.random.default_rng(1).normal(size=(5, 6))
    draws = [model.draw(np.random.default_rng(i), 5) for i in range(2)]
    together, reading = model.step(model.start(wrench, draws[0], memory=9), wrench + 1, 0.002, draws[1])

    def alone(one, *chosen):
        first, second = chosen
        state, reading = model.step(model.start(one, first, memory=9), one + 1, 0.002, second)
        return state, reading

    rows = [jax.tree.map(lambda x: jnp.asarray(x)[:, None], one) for one in draws]
    state, mapped = jax.vmap(alone)(jnp.asarray(wrench), *rows)
    np.testing.assert_allclose(mapped, reading, atol=1e-12)
    for ours, theirs in zip(state, together, strict=True):
        np.testing.assert_allclose(ours[:, 0], theirs, atol=1e-12)


def test_bias_and_noise_scatter_as_stated():
    model, count, dt = model_of({}), 40_000, 2.0
    rng = np.random.default_rng(2)
    state = model.start(np.zeros((count, 6)), model.draw(rng, count))
    np.testing.assert_allclose(state.bias.mean(0), [1.0] * 3 + [0.1] * 3, atol=0.05)
    np.testing.assert_allclose(state.bias.std(0), [2.0] * 3 + [0.2] * 3, rtol=0.02)
    later, reading = model.step(state, np.zeros((count, 6)), dt, model.draw(rng, count))
    gained = later.bias - state.bias - state.drift * 50 * (1 - np.exp(-dt / 50))
    np.testing.assert_allclose(gained.std(0), 2e-3 * np.sqrt(dt**3 / 3) * np.array([1] * 3 + [0.05] * 3), rtol=0.02)
    np.testing.assert_allclose(
        (reading + later.bias).std(0), np.hypot([0.1] * 3 + [0.004] * 3, [0.2] * 3 + [0.01] * 3), rtol=0.02
    )
    together = np.mean(later.correlated * state.correlated, 0) / state.correlated.var(0)
    np.testing.assert_allclose(together, np.exp(-dt / 0.3), atol=0.02)


def test_vibration_spikes_range_and_lattice_scatter_as_stated():
    model, count = quiet(model_of(SAMPLES | {"dropped_samples": {"rate": 0.1, "repeated": 0.0}})), 40_000
    rng = np.random.default_rng(3)
    speeds = np.full((count, 7), 0.2)
    state = model.start(np.zeros((count, 6)), model.draw(rng, count))
    state, reading = model.step(state, np.zeros((count, 6)), 0.002, model.draw(rng, count), speeds)
    assert abs(np.isnan(reading).all(1).mean() - 0.1) < 0.01
    arrived = reading[np.isfinite(reading[:, 0])]
    spikes = np.abs(arrived[:, 0]) > 3
    assert abs(spikes.mean() - 0.02) < 0.003
    expected = np.sqrt(7 * 0.01 * 0.04 / np.sqrt(1 + 0.16))
    np.testing.assert_allclose(arrived[~spikes, 0].std(), expected, rtol=0.02)
    np.testing.assert_allclose(np.round(arrived / state.reading.dtype.type(0.01), 6)[:, 0] % 1, 0, atol=1e-6)
    _, reading = model.step(state, np.full((count, 6), 99.0), 0.002, model.draw(rng, count))
    assert np.nanmax(np.abs(reading[:, 0])) <= 12.0 + 5.0


def test_the_sensor_reports_its_own_sign_and_may_be_zeroed_at_the_start():
    sensor = {"noise_std": 0.1, "reports": "wrench_on_sensor", "rezeroed": True}
    model = quiet(model_of({}, sensor))
    draws, load = model.draw(np.random.default_rng(0)), np.array([1.0, 2, 3, 4, 5, 6])
    state = model.start(load, draws)
    np.testing.assert_allclose(model.step(state, load, 0.01, draws)[1], 0, atol=1e-15)
    np.testing.assert_allclose(model.step(state, load + 1, 0.01, draws)[1], -1)


def test_derivatives_are_finite():
    model, draws = model_of(MEAN | SAMPLES), None
    draws = jax.tree.map(jnp.asarray, model.draw(np.random.default_rng(0)))

    def loss(model, load):
        state = model.start(load, draws, memory=9)
        return jnp.nansum(model.step(state, load, 0.002, draws, jnp.zeros(7), 30.0)[1] ** 2)

    slopes = jax.grad(loss, (0, 1))(jax.tree.map(jnp.asarray, model), jnp.arange(6.0))
    assert all(np.isfinite(x).all() for x in jax.tree.leaves(slopes))


def test_a_delay_is_a_straight_line_between_the_samples_it_falls_between():
    ages, history = np.array([[0.03, 0.02, 0.01, 0.0]]), np.arange(24.0).reshape(1, 4, 6)
    for delay, expected in ((0.0, 18.0), (0.015, 9.0), (0.03, 0.0), (9.0, 0.0), (-1.0, 18.0)):
        assert delayed_by(np.array(delay), ages, history)[0, 0] == pytest.approx(expected)


def test_a_file_of_the_sensor_comes_back_as_it_was(tmp_path):
    effects = MEAN | SAMPLES | {"tool_mass": {"mass": 1.0}, "cable": {"stiffness": 1.0}}
    setup = parse_setup({"sensor_pose": {}, "sensor": NOISE, "bias": BIASES, "effects": effects})
    (tmp_path / "sensor_model.toml").write_text(sensor_text(setup))
    read, expected = load_sensor_model(tmp_path / "sensor_model.toml"), model_of(MEAN | SAMPLES)
    assert jax.tree.structure(read) == jax.tree.structure(expected)
    for one, other in zip(jax.tree.leaves(read), jax.tree.leaves(expected), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[sensor", "is not valid TOML"),
        (".".join("a" * 40) + " = 1", "has a key of more than 32 parts"),
        ("[sensor]\nnoise_std = -1", "sensor.noise_std"),
        ("[sensor]\nnoise_std = 1\n[tool]\nmass = 1", "tool: unknown key"),
        ("[sensor]\nnoise_std = 1\n[effects.tool_mass]\nmass = 1.0", "effects.tool_mass: is no effect of the sensor"),
        ("[sensor]\nnoise_std = 1\n[effects.low_pass]\ncutoff = -1.0", "effects.low_pass.cutoff"),
    ],
)
def test_mistakes_in_the_file_are_named(tmp_path, text, words):
    (tmp_path / "sensor_model.toml").write_text(text)
    with pytest.raises(SetupError) as caught:
        load_sensor_model(tmp_path / "sensor_model.toml")
    assert words in str(caught.value)
    assert "sensor_model.toml" in str(caught.value)


def test_every_effect_of_the_sensor_is_there_in_the_order_of_the_catalogue():
    theirs = [name for name, effect in CATALOGUE.items() if effect.stage in ("sensor", "bias", "timing")]
    assert sorted(EFFECTS) == sorted(set(theirs) - {"clock_drift"})
    assert list(EFFECTS) == [name for name in theirs if name in EFFECTS]
