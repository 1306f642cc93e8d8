"""Fits against plain least squares on the same whitened columns, and convergence of the fit of a cable."""

from dataclasses import replace

import numpy as np
import pytest
from small_fits import at_its_best, dense, residual

from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.diagnosis.hypothesis import Hypothesis, at_values, at_zero, movable
from ftbias_jax.diagnosis.problem import make_problem
from ftbias_jax.diagnosis.regression import fit as module
from ftbias_jax.diagnosis.regression.chain_model import to_values
from ftbias_jax.diagnosis.regression.design_matrix import Columns
from ftbias_jax.diagnosis.regression.evaluate import slopes
from ftbias_jax.diagnosis.regression.fit import base, first_order, fit, projection
from ftbias_jax.model.simulate_log import simulate
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.setup import parse_setup

BINS = 50
CABLE = {"stiffness": 10.0, "rest_length": 0.1, "anchor": [0.2, 0.2, 0.9]}


def test_series_are_projected_out():
    rng = np.random.default_rng(0)
    series, errors = rng.normal(size=(5, BINS, 6)), rng.normal(size=(3, BINS, 6))
    coefficients, left = projection(series)(errors)
    alone = dense(Columns(series[:0], series))
    np.testing.assert_allclose(left, [residual(alone, error) for error in errors], atol=1e-7)
    np.testing.assert_allclose(left, errors + np.tensordot(coefficients, alone, 1))
    nothing, untouched = projection(series[:0])(errors)
    assert nothing.shape == (3, 0)
    np.testing.assert_array_equal(untouched, errors)


def test_to_first_order_a_linear_effect_is_fitted_exactly():
    """Exact up to the prior of 30 typical departures, which hardly affects columns of unit size."""
    rng = np.random.default_rng(1)
    accepted, further = at_its_best(rng, 2, BINS), rng.normal(size=(3, BINS, 6))
    found = first_order(accepted, Hypothesis("tool_com", (5, 6, 7), (0.0,) * 3), further)
    np.testing.assert_allclose(
        found.error, residual(np.concatenate([accepted.columns.moving, further]), accepted.error), atol=1e-4
    )
    assert found.free == (0, 1, 5, 6, 7)
    assert found.log_likelihood > accepted.log_likelihood
    np.testing.assert_array_equal(found.z[[2, 3, 4]], 0)


@pytest.fixture(scope="module")
def pulled():
    """A log so quiet that a cable's likelihood is a narrow, curved valley; a centre of mass, and a cable far off."""

    @in_float64
    def made():
        stated = parse_setup(SETUP)
        quiet = replace(stated, sensor=replace(stated.sensor, noise_std=0.1 * stated.sensor.noise_std))
        log = simulate(quiet, {"cable": CABLE}, duration=20, rate=100, seed=5).log
        problem, _ = make_problem(quiet, [log])
        center, cable = (problem.catalogue[name] for name in ("tool_com", "cable"))
        far = at_values(problem, cable, stiffness=20.0, rest_length=0.05, anchor=[0.5, 0.1, 0.7])
        return problem, at_zero("tool_com", movable(problem, center)), far

    return made()


@in_float64
def test_numbers_that_can_stand_for_each_other_are_fitted_to_the_end(pulled):
    """Stiffness, rest length and anchor of a cable compensate each other."""
    problem, center, far = pulled
    found = fit(problem, (center, far), base(problem))
    again = fit(problem, found.hypotheses, found)
    assert again.log_likelihood - found.log_likelihood < 0.1
    values = to_values(problem.parts[0].signals, found.z, catalogue=problem.catalogue)["cable"]
    np.testing.assert_allclose(values["anchor"], CABLE["anchor"], atol=5e-3)


@in_float64
def test_a_fit_that_continues_another_works_nothing_out_twice_and_ends_at_the_same_place(pulled, monkeypatch):
    problem, center, far = pulled
    before = fit(problem, (center,), base(problem))
    asked = []

    def counted(problem, z, places):
        asked.append(set(places))
        return slopes(problem, z, places)

    monkeypatch.setattr(module, "slopes", counted)
    continued = fit(problem, (center, far), before)
    assert asked[0] == set(far.free)
    assert all(one == {*center.free, *far.free} for one in asked[1:])
    monkeypatch.undo()
    anew = fit(problem, (center, far), base(problem))
    assert abs(continued.log_likelihood - anew.log_likelihood) < module.ENOUGH
    np.testing.assert_allclose(continued.z, anew.z, atol=0.05)
    fresh = fit(problem, continued.hypotheses, continued, most=0)  # derivatives at the end of the continued fit
    np.testing.assert_allclose(
        continued.columns.moving, fresh.columns.moving, rtol=0.05, atol=1e-2 * np.abs(fresh.columns.moving).max()
    )
