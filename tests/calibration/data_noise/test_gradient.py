"""The climb by gradients: known maxima, known information, and what is left open."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.calibration.data_noise import gradient

COUNT = 500


def white(logs, data):
    """White noise of standard deviations exp(logs)."""
    return -(data**2 / jnp.exp(2 * logs)[None] + 2 * logs[None]).sum() / 2


@dataclass(frozen=True)
class SumOfTwo:
    """White noise whose variance is the sum of two, and a third number that nothing depends on."""

    def __call__(self, logs, data):
        variance = jnp.exp(2 * logs[0]) + jnp.exp(2 * logs[1])
        return -((data**2).sum() / variance + data.size * jnp.log(variance)) / 2


@pytest.fixture(scope="module")
def data():
    return np.random.default_rng(0).normal(size=(COUNT, 2)) * [2.0, 0.1]


def test_the_standard_deviations_of_white_noise_from_starts_wrong_by_thirty(data):
    """Known maximum, known information: 2 T for each logarithm; the parts of the data add up."""
    starts = np.log([[60.0, 3e-3], [0.07, 3.0]])
    told = []
    found = gradient.maximise(white, [data[:300], data[300:]], starts[:, :], lambda *x: told.append(x))
    np.testing.assert_allclose(np.exp(found.logs), np.sqrt((data**2).mean(0)), rtol=1e-4)
    np.testing.assert_allclose(found.stderr, np.sqrt(1 / (2 * COUNT)), rtol=1e-3)
    assert (found.converged, found.starts, found.agreeing) == (True, 2, 2)
    np.testing.assert_allclose(found.value, white(jnp.asarray(found.logs), data), rtol=1e-12)
    assert told[-1][1] <= found.value


def test_it_says_what_the_data_leave_open(data):
    found = gradient.maximise(SumOfTwo(), [data[:, 0]], np.zeros((1, 3)))
    assert found.converged
    assert np.isinf(found.stderr).all()
    assert gradient.open_directions(found.information, ["a", "b", "c"]) == [
        "a only together with b",
        "c (not distinguishable from zero)",
    ]
    squares = np.exp(2 * found.logs[:2])
    np.testing.assert_allclose(squares.sum(), (data[:, 0] ** 2).mean(), rtol=1e-4)
    weights = np.array([[*squares / squares.sum(), 0.0], [1.0, 0.0, 0.0]])
    error, alone = gradient.combination_errors(found.information, weights)
    np.testing.assert_allclose(error, np.sqrt(1 / (2 * COUNT)), rtol=1e-3)
    assert 0.3 < alone < 1  # open: the error of a direction that the data say nothing about is 1


def test_nothing_is_open_where_all_is_determined():
    assert gradient.open_directions(np.diag([100.0, 4.0]), ["a", "b"]) == []
