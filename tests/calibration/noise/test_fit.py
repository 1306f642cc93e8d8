"""Sigma_D from logs of one tool and of three: determined values are found, undetermined ones are named."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.calibration import tune
from ftbias_jax.calibration.noise import fit as data_noise
from ftbias_jax.calibration.noise import values as data_noise_values
from ftbias_jax.calibration.noise.score import WrenchLogs, WrenchScore
from ftbias_jax.calibration.noise.values import KINDS
from ftbias_jax.calibration.tune import stack
from ftbias_jax.model import simulate
from ftbias_jax.model.params import BiasNoise, Params
from ftbias_jax.model.wrench.tool_wrench import measurement_covariance, tool_parameters
from ftbias_jax.types import Sample

COUNT, DT = 1500, 0.01
TRUTH = {
    "linear_acceleration": np.full(3, 0.3),
    "angular_acceleration": np.full(3, 4.0),
    "angular_velocity": np.full(3, 0.02),
    "gravity_direction": np.full(3, 0.01),
}
SENSOR = {"density": "each", "wrench_std": "each"}
TOOLS = [
    (0.2, [0.0, 0.0, 0.03], [1e-4, 0, 0, 1e-4, 0, 1e-4]),
    (1.2, [0.02, -0.01, 0.06], [2e-3, 0, 0, 3e-3, 0, 2e-3]),
    (1.5, [-0.06, 0.08, 0.15], [1e-2, 0, 0, 2e-2, 0, 1e-2]),
]


def variance_of(params):
    bias = params.bias
    return np.diagonal(measurement_covariance(params.theta, bias.data_variance, bias.wrench_variance))


@pytest.fixture(scope="module")
def tools(params):
    """Three tools on one sensor; the joints do not matter here."""
    std = np.repeat([0.1, 0.005], 3) * [1, 1.2, 0.8, 1, 1.3, 0.9]
    prior = jnp.repeat(jnp.array([5, 0.5, 0.01, 1e-3]), 3)
    density = jnp.repeat(jnp.array([0.02, 1e-3]), 3)
    bias = BiasNoise(density, None, jnp.asarray(std) ** 2, jnp.zeros(12), prior)
    gravity = jnp.array([0.0, 0.0, -9.81])
    return [Params(params.arm, gravity, tool_parameters(*map(jnp.array, x)), params.joint, bias) for x in TOOLS]


@pytest.fixture(scope="module")
def parts(tools):
    """A log of each tool with exactly known joints: the reading is minus the bias plus all noise."""
    nothing, dt = np.zeros((COUNT, 6)), np.r_[0.0, np.full(COUNT - 1, DT)]
    logs = []
    for seed, tool in enumerate(tools):
        bias, _ = simulate.bias_process(
            jax.random.key(seed), jnp.cumsum(dt), tool.bias.density, jnp.zeros(6), jnp.zeros(6)
        )
        std = np.sqrt(variance_of(data_noise_values.with_noise(tool, {k: jnp.asarray(v) for k, v in TRUTH.items()})))
        wrench = std * np.random.default_rng(seed).normal(size=(COUNT, 6)) - bias
        log = Sample(dt, nothing[:, :3], nothing[:, :3], np.asarray(wrench))
        logs.append((tool, WrenchLogs(stack([log]), *2 * [jnp.asarray(nothing)[None]])))
    return logs


@pytest.fixture(scope="module")
def from_three(tools, parts):
    return data_noise.fit_data(tools, parts, KINDS["one"] | SENSOR)


def test_three_tools_tell_the_sensor_from_the_motion(tools, from_three):
    """Determined values are within four standard errors of the truth; the others are named."""
    fitted, fit = from_three
    assert fit.optimum.converged
    true = TRUTH | {"density": tools[0].bias.density, "wrench_std": np.sqrt(tools[0].bias.wrench_variance)}
    for name, value in fit.values.items():
        known = np.isfinite(fit.relative_stderr[name])
        off = np.abs(np.log(value / np.asarray(true[name]))) / fit.relative_stderr[name]
        assert (off[known] < 4).all(), name
        assert known.all() == (name in ("density", "wrench_std", "angular_acceleration")), name
    assert fit.undetermined == [
        "data_noise.linear_acceleration only together with data_noise.gravity_direction",
        "data_noise.angular_velocity (not distinguishable from zero)",
    ]
    force = next(words for words in fit.determined if words.startswith("a - g: "))
    assert "linear_acceleration^2 + 96.2 gravity_direction^2 = s^2, s = " in force
    found, error = (float(x) for x in force.split("s = ")[1].removesuffix(" m/s^2").split(" ± "))
    assert abs(found - np.hypot(0.3, 9.81 * 0.01)) < 4 * error
    assert error < 0.01
    for tool, after in zip(tools, fitted, strict=True):
        truth = data_noise_values.with_noise(tool, {k: jnp.asarray(v) for k, v in TRUTH.items()})
        np.testing.assert_allclose(variance_of(after), variance_of(truth), rtol=0.15)


def test_one_tool_determines_six_sums_and_says_which(tools, parts):
    """The sums equal the variances that a fit of the sensor's noise alone finds (errata 11)."""
    (fitted,), fit = data_noise.fit_data(tools[1:2], parts[1:2], KINDS["one"] | {"wrench_std": "each"})
    alone, _ = tune.fit_wrench(tools[1], parts[1:2], {"wrench_std": "each"})
    np.testing.assert_allclose(variance_of(fitted), alone.bias.wrench_variance, rtol=1e-3)
    assert np.linalg.matrix_rank(fit.optimum.information, tol=1.0) == 6
    assert np.isinf(fit.relative_stderr["wrench_std"]).all()
    together = {words.split(" only together with ")[0] for words in fit.undetermined}
    assert {"data_noise.linear_acceleration", "data_noise.angular_acceleration"} <= together
    assert len(fit.undetermined) >= 3  # ten numbers minus six sums; those that are zero share a phrase
    assert "sensor.noise_std[fx]" in " ".join(fit.undetermined)
    assert len(fit.determined) == 6
    words = "fx: sensor.noise_std[fx]^2 + 1.44 linear_acceleration^2 + 0.00533 angular_acceleration^2"
    assert fit.determined[0].startswith(words)


def test_more_numbers_fit_no_worse(tools, parts, from_three):
    """One number for all, then three axes started from it: nested models, with no local optimum in between."""
    (first, *_), fit = data_noise.fit_data(tools, parts, KINDS["three"] | SENSOR)
    assert fit.optimum.value > from_three[1].optimum.value
    assert len(set(fit.values["angular_acceleration"])) == 3
    again = data_noise.fit_data(tools, parts, KINDS["three"] | SENSOR, stated=fit.values)[1]
    np.testing.assert_allclose(again.optimum.value, fit.optimum.value, atol=0.01)
    assert first.bias.data_variance.shape == (36,)


def test_the_gradient_is_that_of_differences(tools, parts):
    """The gradient goes through the hand-written reverse pass and is compared entry by entry."""
    score = WrenchScore((("entries", tuple(range(36))),))
    rng = np.random.default_rng(0)
    logs, direction = jnp.asarray(rng.normal(size=36)), jnp.asarray(rng.normal(size=36))
    value = jax.jit(lambda logs, part: score(logs[:, None], part)[0])
    slope = jax.jit(jax.grad(value))(logs, parts[2])
    difference = (value(logs + 1e-4 * direction, parts[2]) - value(logs - 1e-4 * direction, parts[2])) / 2e-4
    np.testing.assert_allclose(slope @ direction, difference, rtol=1e-6)


def test_it_starts_where_it_is_noticed_or_as_stated(tools):
    start = data_noise_values.starting_values(tools, KINDS["one"], {"gravity_direction": np.array([0.1, 0.0, 0.2])})
    only = {name: jnp.asarray(value) * (name == "linear_acceleration") for name, value in start.items()}
    share = [variance_of(data_noise_values.with_noise(tool, only)) / variance_of(tool) - 1 for tool in tools]
    np.testing.assert_allclose(np.max(share), data_noise_values.START_SHARE_OF_OTHERS, rtol=1e-9)
    np.testing.assert_array_equal(start["gravity_direction"][[0, 2]], [0.1, 0.2])
    assert start["gravity_direction"][1] > 0
