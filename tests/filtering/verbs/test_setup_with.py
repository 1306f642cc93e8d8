"""Parameters of a log, with other noise, are written back into the setup that they came from."""

from dataclasses import fields, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ftbias_jax as ft
from ftbias_jax.filtering.verbs.setup_with import setup_with

TEXT = """
[robot]
model = "panda"

[sensor]
noise_std = [0.1, 0.004]  # by the datasheet

[tool]
mass = 0.9
center_of_mass = [0.01, -0.005, 0.06]
inertia = [2.5e-3, 0.0, 0.0, 2.2e-3, 0.0, 1.1e-3]

[bias]
noise_density = [2e-3, 1e-4]

[joints]
process_noise_density = 30.0

[data_noise]
linear_acceleration = 0.1
"""
NOISE = ("density", "wrench_std", "position_std", "velocity_std", "process_density", "entries")


@pytest.fixture(scope="module")
def setup(tmp_path_factory):
    path = tmp_path_factory.mktemp("setup") / "setup.toml"
    path.write_text(TEXT)
    return ft.load_setup(path)


@pytest.fixture(scope="module")
def log(setup):
    return ft.simulate(setup, duration=1, rate=100, seed=1).log


@pytest.fixture(scope="module")
def params(setup, log):
    return ft.params_for_log(setup, log)


def close(one, two):
    return all(jax.tree.leaves(jax.tree.map(lambda x, y: np.allclose(x, y, rtol=1e-5, atol=1e-12), one, two)))


def test_parameters_that_did_not_change_leave_the_text_as_it_is(setup, params, tmp_path):
    setup_with(setup, params).save(tmp_path / "same.toml")
    assert (tmp_path / "same.toml").read_text() == TEXT


@pytest.mark.parametrize("name", NOISE)
def test_noise_that_was_trained_comes_back_from_the_file(setup, params, log, tmp_path, name):
    moved = {name: ft.unconstrain(params)[name] + jnp.log(2.0)}
    trained = ft.constrain(params, moved)
    setup_with(setup, trained).save(tmp_path / "trained.toml")
    again = ft.params_for_log(ft.load_setup(tmp_path / "trained.toml"), log)
    assert not close(params, again)
    assert close(trained, again)


def test_a_known_noise_level_is_not_counted_twice(setup, log):
    louder = replace(setup, effects={"noise_level": {"scale": 3.0}})
    params = ft.params_for_log(louder, log)
    assert setup_with(louder, params).effects == louder.effects
    doubled = params._replace(bias=params.bias._replace(wrench_variance=4 * params.bias.wrench_variance))
    written = setup_with(louder, doubled)
    assert written.effects == {}
    np.testing.assert_allclose(written.sensor.noise_std, 6 * setup.sensor.noise_std, rtol=1e-6)
    assert close(doubled, ft.params_for_log(written, log))


def test_noise_that_is_faint_is_told_from_none(setup, params, log):
    faint = ft.constrain(params, {"wrench_std": jnp.full(6, np.log(1e-7)), "entries": jnp.full(36, np.log(2e-7))})
    fainter = ft.constrain(faint, {"wrench_std": jnp.full(6, np.log(3e-8)), "entries": jnp.full(36, np.log(4e-8))})
    assert setup_with(setup_with(setup, faint), fainter).sensor.noise_std == pytest.approx(3e-8)
    assert setup_with(setup_with(setup, faint), fainter).data_noise.entries == pytest.approx(4e-8)


def test_a_setup_states_what_a_fit_found_and_not_what_a_filter_takes(setup, params, log):
    """A filter takes eight times the joints' process noise."""
    trained = ft.constrain(params, {name: x + 0.3 for name, x in ft.unconstrain(params).items()})
    written = setup_with(setup, trained)
    stated = np.exp(0.3) * setup.joints.process_noise_density
    np.testing.assert_allclose(written.joints.process_noise_density, stated, rtol=1e-5)
    unguarded = trained._replace(joint=trained.joint._replace(process_density=stated))
    assert close(*(ft.params_for_log(x, log) for x in (written, setup_with(setup, unguarded, guarded=False))))


def test_noise_that_is_correlated_or_grows_with_the_motion_comes_back(setup, params, log):
    six = np.arange(1.0, 7)
    rows = np.outer(np.arange(7.0), six)
    noise = {"correlated_std": 0.01 * six, "correlated_time": six, "vibration": rows, "vibration_speed": np.array(0.5)}
    trained = params._replace(bias=params.bias._replace(**noise, drift_time=10 * six))
    assert close(trained, ft.params_for_log(setup_with(setup, trained), log))
    assert setup_with(setup_with(setup, trained), params).effects == {}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda p: p._replace(theta=1.1 * p.theta), "params.theta: is not what the setup states"),
        (lambda p: p._replace(gravity=-p.gravity), "params.gravity"),
        (lambda p: p._replace(bias=p.bias._replace(prior_std=2 * p.bias.prior_std)), "params.bias.prior_std"),
        (lambda p: p._replace(bias=p.bias._replace(density=p.bias.density * np.nan)), "params.density: has .*nan"),
        (lambda p: p._replace(bias=p.bias._replace(wrench_variance=-p.bias.wrench_variance)), "params.wrench_variance"),
        (lambda p: jax.tree.map(lambda x: jnp.stack([x, x]), p), "params"),
        (
            lambda p: p._replace(bias=p.bias._replace(density=jnp.stack([p.bias.density] * 2))),
            r"params.density: has shape \(2, 6\) instead of \(6,\)",
        ),
    ],
)
def test_what_is_no_noise_of_this_setup_is_refused(setup, params, change, words):
    with pytest.raises(ft.UsageError, match=words):
        setup_with(setup, change(params))


def test_a_sensor_that_was_zeroed_in_the_first_pose_is_no_change(setup, log):
    zeroed = replace(setup, sensor=replace(setup.sensor, rezeroed=True))
    written = setup_with(zeroed, ft.params_for_log(zeroed, log))
    for section in (field.name for field in fields(written.bias)):
        np.testing.assert_array_equal(getattr(written.bias, section), getattr(zeroed.bias, section))
