"""Series that represent an effect, against what the effect itself does to a reading."""

import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.diagnosis.hypothesis import Change, Event, Slow
from ftbias_jax.diagnosis.problem import Part, Problem
from ftbias_jax.diagnosis.regression.series import settlings, shaped, shaped_events, slope_in_time, steps
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.model.effects.types import Model, Signals

T = np.arange(0, 20, 0.05)
OWN = np.repeat([0, 1], len(T))


@pytest.fixture(scope="module")
def problem():
    """Two logs of 20 s in which the temperature rises by 0.5 K; each has padding."""
    still, model = jnp.zeros((len(T) + 24, 1)), Model(None, jnp.zeros(3), jnp.ones(10))
    t = jnp.asarray(np.pad(T, (0, 24), mode="edge"))
    part = Part(Signals(t, still, still, still, 20 + t / 40, model), None, len(T), None, None)
    nothing = np.zeros(2 * len(T))
    return Problem((part, part), np.tile(T, 2), OWN, nothing, nothing, nothing, (20.0, 20.0), np.ones(6), {})


@pytest.mark.parametrize("ramp", [0.0, 1.5])
def test_a_change_is_that_of_the_catalogue_in_its_own_log(problem, ramp):
    first, second = steps(problem, CATALOGUE["bias_jump"], 1, np.array([3.0, 7.5]), ramp)
    assert second.detail == Change(7.5, 1, ramp)
    after = np.clip((T - 7.5) / ramp, 0, 1) if ramp else (T >= 7.5).astype(float)
    np.testing.assert_allclose(second.shapes[0][OWN == 1], -after, atol=1e-6)  # a bias lowers the reading
    np.testing.assert_array_equal(second.shapes[0][OWN == 0], 0)
    assert (first.shapes[0][OWN == 1] <= second.shapes[0][OWN == 1]).all()  # the first jump is earlier


def test_each_log_may_warm_up_by_itself_and_all_of_them_together(problem):
    found = settlings(problem, CATALOGUE["warmup"])
    times = {h.detail.time_constant for h in found}
    assert min(times) > 0.02 * 20
    assert max(times) < 2 * 20
    assert {h.detail.log for h in found} == {None, 0, 1}
    one = next(h for h in found if h.detail.log == 1)
    np.testing.assert_allclose(one.shapes[0][OWN == 1], np.expm1(-T / one.detail.time_constant), atol=1e-6)
    np.testing.assert_array_equal(one.shapes[0][OWN == 0], 0)


def test_the_temperature_drifts_all_logs_alike_if_it_moves(problem):
    found = settlings(problem, CATALOGUE["temperature_drift"])
    assert found[0].detail == Slow(0.0, None)
    np.testing.assert_allclose(found[0].shapes[0], -np.tile(T, 2) / 40, atol=1e-5)
    assert max(h.detail.time_constant for h in found) < 10.0
    parts = tuple(
        part._replace(signals=part.signals._replace(temperature=20 + part.signals.t / 80)) for part in problem.parts
    )
    assert settlings(problem._replace(parts=parts), CATALOGUE["temperature_drift"]) == []  # 0.25 K is too little


def test_the_slope_in_time_is_the_derivative(problem):
    found = next(h for h in settlings(problem, CATALOGUE["warmup"]) if h.detail.log == 0 and h.detail.time_constant > 3)
    tau = found.detail.time_constant
    slope = slope_in_time(problem, found)
    expected = T / tau**2 * np.exp(-T / tau)
    np.testing.assert_allclose(slope[OWN == 0], expected, atol=0.02 * expected.max())
    np.testing.assert_array_equal(slope[OWN == 1], 0)


def test_events_have_hats_of_their_own(problem):
    h = shaped_events(problem, "contact", [Event(0, 2.0, 3.0), Event(1, 6.0, 8.0)], 8)
    assert [one.series for one in shaped(h)] == [8, 8]
    assert len(h.shapes) == 16
    whole = np.sum(h.shapes[:8], axis=0)
    inside = (OWN == 0) & (problem.t >= 2) & (problem.t < 3)
    np.testing.assert_allclose(whole[inside], 1, atol=1e-9)
    np.testing.assert_array_equal(whole[~inside], 0)
