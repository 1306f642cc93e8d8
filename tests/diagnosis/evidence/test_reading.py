"""Standard error of the predicted reading against fits of many logs, and against fits with fewer free parameters."""

import numpy as np
import pytest

from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.diagnosis.evidence.reading import stderr_of_reading
from ftbias_jax.diagnosis.hypothesis import at_zero, movable
from ftbias_jax.diagnosis.problem import make_problem
from ftbias_jax.diagnosis.regression.evaluate import slopes
from ftbias_jax.diagnosis.regression.fit import base, covariance, fit, predicted
from ftbias_jax.model.simulate_log import simulate
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.setup import parse_setup

STATED = parse_setup(SETUP)
MOTION = simulate(STATED, {}, duration=20, rate=100, seed=1).log
NAMES = ("tool_mass", "gravity_tilt")
"""Two effects that act in a similar way."""


@in_float64
def fitted(seed, names=NAMES):
    problem, _ = make_problem(STATED, [simulate(STATED, {}, motion=MOTION, seed=seed).log])
    free = tuple(at_zero(name, movable(problem, problem.catalogue[name])) for name in names)
    return problem, fit(problem, free, base(problem))


@pytest.fixture(scope="module")
def of_both():
    return fitted(0)


@in_float64
def test_it_is_as_large_as_the_errors_of_many_logs(of_both):
    found = [of_both, *(fitted(seed) for seed in range(1, 12))]
    errors = [predicted(problem, one) - predicted(problem, base(problem)) for problem, one in found]
    scatter = np.sqrt(np.square(errors).mean((0, 1)))
    np.testing.assert_allclose(stderr_of_reading(*of_both)[:3], scatter[:3], rtol=0.6)


@in_float64
def test_what_is_given_adds_nothing_by_itself(of_both):
    """The rest is as uncertain as if only it were free, except for the block scores, which may widen either."""
    problem, both = of_both
    _, alone = fitted(0, NAMES[1:])
    given = stderr_of_reading(problem, both, NAMES[:1])
    np.testing.assert_allclose(given, stderr_of_reading(problem, alone), rtol=0.3)
    assert (given[:3] < stderr_of_reading(problem, both)[:3]).all()
    assert stderr_of_reading(problem, both, NAMES) is None


@in_float64
def test_directions_that_change_no_reading_add_nothing(of_both):
    """Steps of one standard deviation along each axis of the covariance, one after the other."""
    problem, both = of_both
    variance, axes = np.linalg.eigh(covariance(problem, both))
    columns = slopes(problem, both.z, both.free)
    steps = [np.sqrt(max(v, 0)) * np.tensordot(axis, columns, 1) for v, axis in zip(variance, axes.T, strict=True)]
    np.testing.assert_allclose(stderr_of_reading(problem, both), np.sqrt(np.square(steps).sum(0).mean(0)), rtol=1e-6)
