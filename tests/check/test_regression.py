"""The least squares behind the check."""

import numpy as np
import pytest
import small_checks

import ftbias_jax as ft
from ftbias_jax.check.bins import bins_of
from ftbias_jax.check.regression import Tool, exactly, free_tool, no_tool, within_reach
from ftbias_jax.check.state import case_of_bins, stated


@pytest.fixture(scope="module")
def state():
    tables, arrays = small_checks.right_log()
    setup = ft.parse_setup(tables)
    return stated(case_of_bins(setup, [bins_of(ft.Log.from_arrays(setup, **arrays), setup)]))


def test_a_right_setup_leaves_noise_and_no_tool_leaves_all(state):
    raw, exact, free = (state.fit(tool(state.tool)).square for tool in (lambda _: no_tool(), exactly, free_tool))
    assert (exact < 0.05 * raw).all()
    np.testing.assert_allclose(free, exact, rtol=0.1)
    noise = state.case.setup.sensor.noise_std[0]
    assert 0.5 < exact[0] / (3 * noise**2 / 10) < 1.2


def test_any_tool_is_found_by_a_free_fit(state):
    heavy = state.but(wrench=3 * state.wrench)
    np.testing.assert_allclose(heavy.fit(free_tool(state.tool)).fit.theta[:4], 3 * state.tool.theta[:4], atol=0.03)
    assert 1 < heavy.fit().fit.theta[0] / state.tool.theta[0] < 1.25


def test_touched_bins_are_left_out(state):
    touched = state.wrench.copy()
    touched[30:60] += 40.0
    np.testing.assert_allclose(state.but(wrench=touched).fit().square, state.fit().square, rtol=1)


def test_the_bounded_minimum_is_that_of_a_search():
    rng = np.random.default_rng(0)
    X, y = rng.normal(size=(40, 10)), rng.normal(size=40)
    tool = Tool(rng.normal(size=10), rng.uniform(0.01, 0.1, 10))
    found = within_reach(X.T @ X, X.T @ y, tool)
    steps = rng.normal(size=(20000, 10))
    steps *= rng.uniform(0, 1, (20000, 1)) ** 0.1 / np.linalg.norm(steps, axis=1, keepdims=True)
    best = min(((X @ (tool.theta + tool.reach * step) - y) ** 2).sum() for step in steps)
    assert np.linalg.norm((found - tool.theta) / tool.reach) <= 1 + 1e-9
    assert ((X @ found - y) ** 2).sum() <= best + 1e-6
