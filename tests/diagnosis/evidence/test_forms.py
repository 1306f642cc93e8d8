"""Error of a tool due to the form of a cause beside it, against plain least squares and with another filter."""

from dataclasses import replace

import numpy as np
import pytest
from small_fits import dense, shift

from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.diagnosis.evidence import forms
from ftbias_jax.diagnosis.evidence.estimates import parameters
from ftbias_jax.diagnosis.evidence.forms import spread_by_other_forms
from ftbias_jax.diagnosis.hypothesis import at_values, at_zero, movable
from ftbias_jax.diagnosis.problem import make_problem
from ftbias_jax.diagnosis.regression.fit import base, fit
from ftbias_jax.model.simulate_log import simulate
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.setup import parse_setup

TRUE = parse_setup(SETUP)
LIGHT = replace(TRUE, tool=replace(TRUE.tool, mass=0.86 * TRUE.tool.mass))
WINDOW = 51
"""Length of a moving average in samples."""


def averaged(log):
    """The log with every reading replaced by the mean of the last WINDOW readings."""
    padded = np.concatenate([np.repeat(log.wrench[:1], WINDOW - 1, 0), log.wrench])
    return log._replace(wrench=np.lib.stride_tricks.sliding_window_view(padded, WINDOW, 0).mean(-1))


@in_float64
def fitted(log):
    """The problem of a log, and the fit of a mass and a low-pass to it."""
    problem, _ = make_problem(LIGHT, [log])
    mass, low_pass = (problem.catalogue[name] for name in ("tool_mass", "low_pass"))
    hypotheses = at_zero("tool_mass", movable(problem, mass)), at_values(problem, low_pass, cutoff=2.0)
    return problem, fit(problem, hypotheses, base(problem))


@pytest.fixture(scope="module")
def log():
    return simulate(TRUE, {}, duration=20, rate=100, seed=5).log


@pytest.fixture(scope="module")
def of_average(log):
    return fitted(averaged(log))


@in_float64
def mass_of(problem, found, *, either):
    values, stderr = parameters(problem, found, found.hypotheses[0], either=either)
    return values["mass"], stderr["mass"]


def test_a_mass_beside_a_filter_of_another_form_is_as_uncertain_as_it_is_wrong(of_average):
    mass, alone = mass_of(*of_average, either=False)
    _, beside = mass_of(*of_average, either=True)
    assert 3 * alone < abs(mass - TRUE.tool.mass) < 3 * beside


def test_a_mass_beside_a_filter_of_the_right_form_is_hardly_less_certain():
    problem, found = fitted(simulate(TRUE, {"low_pass": {"cutoff": 2.0}}, duration=20, rate=100, seed=5).log)
    _, alone = mass_of(problem, found, either=False)
    mass, beside = mass_of(problem, found, either=True)
    assert alone <= beside < 2 * alone
    assert abs(mass - TRUE.tool.mass) < 3 * beside


@in_float64
def test_it_is_the_variance_and_the_move_of_plain_least_squares(of_average):
    problem, found = of_average
    made = forms._other_forms(problem, found, found.hypotheses[1])
    columns = np.concatenate([dense(found.columns), made]).reshape(-1, found.error.size)
    prior = np.eye(len(columns))[-len(made) :].T  # a prior row that pulls each form to zero
    wider, error = np.concatenate([columns, prior], 1), np.concatenate([found.error.ravel(), np.zeros(len(made))])
    move = shift(wider, error)[0] - shift(columns[: -len(made)], found.error)[0]
    variances = [np.linalg.inv(x @ x.T)[0, 0] for x in (wider, columns[: -len(made)])]
    expected = variances[0] - variances[1] + move**2
    got = spread_by_other_forms(problem, found, found.hypotheses[0])
    np.testing.assert_allclose(got, [[expected]], rtol=1e-3)  # the package's fit has a weak prior of all numbers


@in_float64
def test_a_tool_has_no_other_form(of_average):
    problem, found = of_average
    np.testing.assert_array_equal(spread_by_other_forms(problem, found, found.hypotheses[1]), 0)
