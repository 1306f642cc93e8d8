import numpy as np
import pytest

from ftbias_jax.errors import UsageError
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.planning.asked import Asked
from ftbias_jax.planning.forecast import Cannot, forecast


def asked(name="tool", size=3, scale=1.0):
    labels = tuple(f"p{i}" for i in range(size))
    return Asked(name, labels, ("1",) * size, np.zeros(size), np.full(size, scale), np.zeros(0))


def test_errors_are_those_of_the_inverse_information_and_of_the_sum_with_that_of_logs():
    rng = np.random.default_rng(0)
    plan, logs = (x @ x.T for x in rng.normal(size=(2, 3, 50)))
    told = forecast([asked()], plan, 0 * plan, logs, [])
    for found, information in ((told.plan, plan), (told.logs, logs), (told.together, plan + logs)):
        np.testing.assert_allclose(found, np.sqrt(np.diag(np.linalg.inv(information))), rtol=1e-3)
    assert told.cannot == ()


def test_a_mixture_that_no_motion_shows_is_named_by_its_parts():
    same = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]) * 1e4
    told = forecast([asked()], same, 0 * same, None, [])
    assert np.isnan(told.plan).tolist() == [True, True, False]
    assert [one.pair for one in told.cannot] == ["p0, p1"]


def test_nothing_is_planned_for_what_standing_still_shows_as_well():
    with pytest.raises(UsageError, match="no motion gives smaller standard errors than standing still"):
        forecast([asked()], 1.05 * np.eye(3), np.eye(3), None, [])
    with pytest.raises(UsageError, match="no motion tells: it changes the reading of no motion"):
        forecast([asked()], 1e-3 * np.eye(3), 1e-3 * np.eye(3), None, [])


def told_of(*columns):
    """Products of each effect's residual and the other's derivative in both directions, and the inertia."""
    stacked = np.concatenate([np.stack(columns), np.zeros((6, len(columns[0])))])
    return stacked @ stacked.T


def two():
    return [asked("tool_mass", 1), asked("gain", 1)], [CATALOGUE["tool_mass"], CATALOGUE["gain"]]


def test_exact_twins_are_refused_with_the_measurement_that_separates_them():
    column = 10 * np.ones(50)
    with pytest.raises(UsageError) as caught:
        forecast(two()[0], told_of(column, column, 2 * column, 2 * column), np.zeros((10, 10)), None, two()[1])
    assert "no motion separates tool_mass and gain, as large as" in str(caught.value)
    assert "hang a known weight on the tool" in caught.value.remedy


@pytest.mark.parametrize(("size", "cannot"), [(2.0, 0), (0.5, 1)])
def test_what_separates_two_effects_is_half_the_squares_that_the_other_leaves(size, cannot):
    one, other = size * np.ones(100), np.ones(100) + np.resize([1.0, -1.0], 100)
    told = forecast(two()[0], told_of(one, other, size * other, one), np.zeros((10, 10)), None, two()[1])
    rest = one - other * (one @ other) / (other @ other)
    assert told.separates == pytest.approx({"tool_mass:gain": rest @ rest / 2}, rel=1e-6)
    assert len(told.cannot) == cannot
    assert told.labels == ("tool_mass.p0", "gain.p0")
    assert all(isinstance(x, Cannot) for x in told.cannot)


def test_what_the_inertia_could_do_does_not_separate_two_effects():
    one, other = np.eye(2).repeat(20, 1) * 3
    told, inertia = told_of(one, other, other, one), np.zeros((6, 40))
    assert forecast(two()[0], told, np.zeros((10, 10)), None, two()[1]).separates["tool_mass:gain"] > 50
    inertia[0] = 1e3 * one
    stacked = np.concatenate([np.stack([one, other, other, one]), inertia])
    with pytest.raises(UsageError, match="no motion separates"):
        forecast(two()[0], stacked @ stacked.T, np.zeros((10, 10)), None, two()[1])
