"""Newton's iterations on problems whose optimum is known."""

import pickle
from concurrent.futures import ThreadPoolExecutor

import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.calibration import newton
from ftbias_jax.calibration.noise.words import combination_errors, open_directions

LANES = 4
WHOLE = [None]  # the data, as one part
EACH = np.array([[0, 1, 2, 3], [4, 5, 6, 7]])
ONE_LANE = np.arange(3)[:, None]
COUNT = 500
BENT = np.array([[40.0, 10.0], [10.0, 20.0]])


def quadratic(x, part=None):
    """The optimum is at (lane, -lane), with the same curvature in every lane."""
    miss = x - jnp.arange(float(LANES))[None] * jnp.array([[1.0], [-1.0]])
    return -(miss * (BENT @ miss)).sum(0) / 2


def banana(x, part=None):
    """An exponential valley, far from quadratic, with its optimum at (1, 1)."""
    return -jnp.cosh(x[0] - 1) - 10 * (jnp.exp(x[1] - x[0]) - 1) ** 2


def test_a_quadratic_is_solved():
    best = newton.maximise(quadratic, WHOLE, np.full(8, 0.5)[None], EACH)
    assert best.converged
    np.testing.assert_allclose(best.logs, [0, 1, 2, 3, 0, -1, -2, -3], atol=1e-4)
    np.testing.assert_allclose(best.value, 0, atol=1e-8)
    np.testing.assert_allclose(best.information, np.kron(BENT, np.eye(LANES)), atol=1e-5)
    np.testing.assert_allclose(best.stderr[[0, 4]], np.sqrt(np.diag(np.linalg.inv(BENT))), rtol=1e-6)


def test_tied_lanes_share_their_best_compromise():
    """All lanes share the first value, and pairs of lanes share the second."""
    index = np.array([[0, 0, 0, 0], [1, 1, 2, 2]])
    best = newton.maximise(quadratic, WHOLE, np.zeros(3)[None], index)
    # Least squares over the lanes, each weighted by BENT.
    spread = np.zeros((LANES, 2, 3))
    for lane in range(LANES):
        spread[lane, [0, 1], index[:, lane]] = 1
    information = np.einsum("lki,km,lmj->ij", spread, BENT, spread)
    target = np.stack([np.arange(LANES), -np.arange(LANES)], 1)
    expected = np.linalg.solve(information, np.einsum("lki,km,lm->i", spread, BENT, target))
    np.testing.assert_allclose(best.logs, expected, atol=1e-4)
    np.testing.assert_allclose(best.information, information, atol=1e-5)


@pytest.mark.parametrize("start", [-8.0, 0.0, 5.0])
def test_any_start_reaches_the_optimum_and_never_goes_down(start):
    seen = []
    best = newton.maximise(
        banana, WHOLE, np.full(2, start)[None], EACH[:, :1] // 4, lambda _, value: seen.append(value)
    )
    assert best.converged
    np.testing.assert_allclose(best.logs, 1, atol=0.01)
    assert (np.diff([banana(np.full(2, start)), *seen]) >= 0).all()
    assert best.value == seen[-1]


def test_parts_of_the_data_lead_to_the_optimum_of_all():
    """The parts have different optima; the likelihood of all is best at their mean."""
    pulls = [jnp.full((1, 1), float(pull)) for pull in np.random.default_rng(0).normal(3.0, 0.3, 40)]

    def score(x, pull):
        return -2 * jnp.cosh(x - pull)[0]

    best = newton.maximise(score, pulls, np.array([-5.0])[None], np.array([[0]]))
    centre = np.log(np.sum(np.exp(pulls)) / np.sum(np.exp(-np.array(pulls)))) / 2
    assert best.converged
    assert best.iterations <= 3
    np.testing.assert_allclose(best.logs, centre, atol=1e-4)
    np.testing.assert_allclose(best.value, -2 * np.cosh(centre - np.array(pulls)).sum(), atol=newton.SMALL_GAIN)
    np.testing.assert_allclose(best.information, [[2 * np.cosh(centre - np.array(pulls)).sum()]], rtol=1e-3)


class Pickling(ThreadPoolExecutor):
    """An executor that pickles its arguments, as on the way to another process."""

    def submit(self, fn, /, *args, **kwargs):
        return super().submit(*pickle.loads(pickle.dumps((fn, *args))))


def test_workers_of_an_executor_lead_to_the_same_optimum():
    parts = [np.array([i - 4.0, 2.0]) for i in range(9)]
    alone = newton.maximise(valley, parts, np.zeros(2)[None], EACH[:, :1] // 4)
    with Pickling(2) as executor:
        best = newton.maximise(valley, parts, np.zeros(2)[None], EACH[:, :1] // 4, executor=executor)
    assert best.converged
    np.testing.assert_array_equal(best.logs, alone.logs)


def valley(x, part):
    """Every part has a valley with its own optimum."""
    return banana(x) - part[1] * (x[0] - part[0]) ** 2


def test_the_best_of_several_starts_and_how_many_agree():
    """The objective has two hills, the higher one at 4."""

    def score(x, part):
        return jnp.logaddexp(-2 * x[0] ** 2, 3 - 2 * (x[0] - 4) ** 2)

    best = newton.maximise(score, WHOLE, np.array([[-0.5], [3.9], [4.2]]), np.array([[0]]))
    np.testing.assert_allclose(best.logs, 4, atol=1e-3)
    np.testing.assert_allclose(best.value, 3, atol=newton.SMALL_GAIN)
    assert (best.agreeing, best.starts) == (2, 3)


def test_a_step_into_nonsense_is_shortened():
    """The likelihood is NaN beyond 2, where a Newton step from the start would end."""

    def score(x, part):
        return jnp.where(x[0] < 2, -jnp.cosh(x[0] - 1.8), jnp.nan)

    best = newton.maximise(score, WHOLE, np.array([0.6])[None], np.array([[0]]))
    np.testing.assert_allclose(best.logs, 1.8, atol=0.01)


def test_too_few_iterations_are_told(monkeypatch):
    monkeypatch.setattr(newton, "MAX_ITERATIONS", 2)
    assert not newton.maximise(banana, WHOLE, np.full(2, -8.0)[None], EACH[:, :1] // 4).converged


def sum_of_two(logs, data):
    """White noise whose variance is the sum of two numbers, and a third number that does not affect it."""
    variance = jnp.exp(2 * logs[0]) + jnp.exp(2 * logs[1])
    return -((data**2).sum() / variance + data.size * jnp.log(variance)) / 2


def test_it_says_what_the_data_leave_open():
    data = 2 * np.random.default_rng(0).normal(size=COUNT)
    found = newton.maximise(sum_of_two, [data], np.zeros((1, 3)), ONE_LANE)
    assert found.converged
    assert np.isinf(found.stderr).all()
    assert open_directions(found.information, ["a", "b", "c"]) == [
        "a only together with b",
        "c (not distinguishable from zero)",
    ]
    assert open_directions(np.eye(3) * 100, ["a", "b", "c"]) == []
    squares = np.exp(2 * found.logs[:2])
    np.testing.assert_allclose(squares.sum(), (data**2).mean(), rtol=1e-4)
    weights = np.array([[*squares / squares.sum(), 0.0], [1.0, 0.0, 0.0]])
    error, alone = combination_errors(found.information, weights)
    np.testing.assert_allclose(error, np.sqrt(1 / (2 * COUNT)), rtol=1e-3)
    assert 0.3 < alone < 1  # undetermined: the standard error along a direction without information is 1


def test_many_gradients_are_taken_some_at_a_time():
    count = 2 * newton.GRADIENTS_AT_ONCE + 3
    pulls = np.arange(count) / count

    def score(x, part):
        return -((jnp.exp(x) - jnp.exp(pulls)[:, None]) ** 2).sum(0) * 1e3

    best = newton.maximise(score, WHOLE, np.full(count, 0.3)[None], np.arange(count)[:, None])
    assert best.converged
    np.testing.assert_allclose(best.logs, pulls, atol=1e-3)
