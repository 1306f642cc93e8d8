"""Noise that grows with the motion, recovered by the likelihood's gradient, and written if held-out blocks agree."""

import tomllib

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import small_archive

import ftbias_jax as ft
from ftbias_jax.calibration import tune_motion
from ftbias_jax.calibration.judgement import HeldOut
from ftbias_jax.calibration.noise.score import WrenchLogs
from ftbias_jax.calibration.tune_blocks import LogInBlocks
from ftbias_jax.calibration.tune_result import TuneResult, is_better
from ftbias_jax.filtering.noise.log_noise import nothing
from ftbias_jax.filtering.noise.vibration import Shares, Vibration
from ftbias_jax.model import simulate
from ftbias_jax.types import Sample

COUNT, DT, CORNER = 6000, 0.01, 0.2
STD = np.repeat([0.1, 0.005], 3)
WEIGHTS = np.outer([4.0, 0.0, 12.0], STD**2 / CORNER)
EACH = {"density": "each", "wrench_std": "each"}


@pytest.fixture(scope="module")
def truth(params):
    bias = params.bias._replace(
        density=jnp.repeat(jnp.array([0.02, 1e-3]), 3),
        data_variance=None,
        wrench_variance=jnp.asarray(STD) ** 2,
        prior_mean=jnp.zeros(12),
    )
    return params._replace(bias=bias)


def moving_log(truth, seed, corner=CORNER):
    """A log with pauses and exactly known joints; the reading is minus the bias plus all noise."""
    rng = np.random.default_rng(seed)
    t = DT * np.arange(COUNT)
    swing = np.sin(2 * np.pi * rng.uniform(0.05, 0.4, 3) * t[:, None] + rng.uniform(0, 6, 3))
    velocity = swing * (np.sin(0.7 * t[:, None]) > -0.3)
    bias, _ = simulate.bias_process(
        jax.random.key(seed), jnp.asarray(t), truth.bias.density, jnp.zeros(6), jnp.zeros(6)
    )
    variance = STD**2 + (velocity**2 / np.sqrt(1 + (velocity / corner) ** 2)) @ WEIGHTS
    wrench = np.sqrt(variance) * rng.normal(size=(COUNT, 6)) - bias
    nothing = np.zeros((COUNT, 6))
    samples = Sample(np.diff(t, prepend=t[:1]), nothing[:, :3], nothing[:, :3], np.asarray(wrench))
    return jax.tree.map(lambda x: x[None], WrenchLogs(samples, nothing, nothing, velocity))


def shown(factor, speed):
    """Start of the fit as blocks may give it: weights wrong by a factor, and zero where the true weight is zero."""
    one = np.ones(6)
    return Vibration(one, factor * WEIGHTS, speed, 50.0, Shares(one, one), True)


@pytest.mark.slow
def test_weights_speed_and_the_rest_come_back_within_their_errors(truth):
    start = truth._replace(bias=truth.bias._replace(wrench_variance=4 * truth.bias.wrench_variance))
    logs = [moving_log(truth, seed) for seed in (0, 1)]
    fitted, fit = tune_motion.fit_motion(start, logs, shown(0.3, 0.5), EACH)
    assert fit.optimum.converged
    true = {"density": truth.bias.density, "wrench_std": STD, "vibration_speed": np.array([CORNER])}
    for name, value in true.items():
        off = np.abs(np.log(fit.values[name] / np.asarray(value))) / fit.relative_stderr[name]
        assert off.max() < 4, name
    moving = WEIGHTS > 0
    off = np.abs(np.log(fit.values["vibration"][moving] / WEIGHTS[moving])) / fit.relative_stderr["vibration"][moving]
    assert off.max() < 4
    assert not fit.values["vibration"][~moving].any()
    np.testing.assert_allclose(fitted.bias.vibration, fit.values["vibration"])
    np.testing.assert_allclose(fitted.bias.vibration_speed, fit.values["vibration_speed"][0])
    np.testing.assert_allclose(jnp.sqrt(fitted.bias.wrench_variance), fit.values["wrench_std"])


def test_a_speed_below_the_least_that_a_setup_states_is_that_one(truth):
    """If noise grows linearly with the speed, any bend far below the log's speeds gives the same variance."""
    log = jax.tree.map(lambda x: x[:, ::4], moving_log(truth, 2, corner=1e-6))
    steep = shown(1.0, 1e-5)._replace(per_speed=WEIGHTS * CORNER / 1e-5)
    fitted, fit = tune_motion.fit_motion(truth, [log], steep, {})
    assert fit.values["vibration_speed"][0] == fitted.bias.vibration_speed >= tune_motion.LEAST_SPEED


def test_the_log_that_shows_it_best_is_where_to_start():
    best, other = shown(1.0, 0.2), shown(0.5, None)._replace(gain=20.0)
    none = best._replace(per_speed=np.zeros_like(WEIGHTS), gain=1.0)
    logs = [LogInBlocks(None, nothing()._replace(vibration=one)) for one in (None, other, best)]
    assert tune_motion.shown_vibration(logs) is best
    assert tune_motion.shown_vibration([LogInBlocks(None, nothing()._replace(vibration=none))]) is None
    assert tune_motion.shown_vibration([]) is None


def result(after, reasons=()):
    setup = ft.parse_setup(tomllib.loads(small_archive.SETUP), "setup.toml")
    scores = (HeldOut("joint", 0.0, 0.0, 0.1), HeldOut("wrench", 0.0, after, 0.1))
    return TuneResult(setup, {}, scores, reasons=reasons)


@pytest.mark.parametrize(
    ("moving", "plain", "taken"),
    [
        (result(5.0), result(3.0), True),
        (result(3.5), result(3.0), False),
        (result(5.0, ("worse",)), result(3.0), False),
        (result(5.0, ("worse",)), result(3.0, ("worse",)), True),
    ],
    ids=["better", "by chance", "forecasts worse", "both forecast worse"],
)
def test_it_is_taken_where_it_holds_out_better_and_forecasts_no_worse(moving, plain, taken):
    assert is_better(moving, plain) == taken


@pytest.mark.slow
def test_tune_writes_the_vibration_of_a_log():
    tables = tomllib.loads(small_archive.SETUP)
    setup = ft.parse_setup(tables, "setup.toml")
    n = len(setup.robot.screws)
    rows = np.outer(np.ones(n), 40 * setup.sensor.noise_std**2)
    made = ft.simulate(
        setup, {"vibration": {"variance": rows, "speed": 0.1}}, duration=30, rate=100, motion="moves", seed=3
    )
    tuned = ft.tune(setup, [made.log], fit=["sensor"], restarts=0, hold_out=0.3)
    found = tuned.setup.effects["vibration"]
    assert "vibration_speed" in str(tuned)
    dq = np.full(n, 0.5)
    ours = (dq**2 / np.sqrt(1 + (dq / found["speed"]) ** 2)) @ np.array(found["variance"])
    np.testing.assert_allclose(ours, (dq**2 / np.sqrt(1 + (dq / 0.1) ** 2)) @ rows, rtol=0.5)
    np.testing.assert_allclose(tuned.setup.sensor.noise_std, setup.sensor.noise_std, rtol=0.3)
    assert tuned.held_out[1].after > tuned.held_out[1].before + 10
