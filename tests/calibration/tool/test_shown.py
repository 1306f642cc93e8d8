"""What a log determines of a tool: scatter between blocks, held-out judgement of the inertia, retained parameters."""

import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.calibration.tool import physical, shown
from ftbias_jax.filtering.innovation_regression import Linear, Prior

COUNT, DT = 4000, 0.01
DTS = np.r_[0.0, np.full(COUNT - 1, DT)]
STATED = np.array([0.9, 0.01, -0.02, 0.06, 0.004, 0, 0, 0.004, 0, 0.003])
HEAVY = np.array([1.1, 0.01, 0.02, 0.05, 0.008, 5e-4, 0, 0.009, 0, 0.006])
UNITS = physical.tool_units(0.9)
X = np.r_[physical.coordinates(jnp.asarray(physical.theta_of(STATED))), np.zeros(6)]
PRIOR = Prior(X, np.r_[physical.PRIOR_STD, np.full(6, physical.FIXED)])


def linear_of(sheet, seen, hold=1, seed=0):
    """A log with this signal-to-noise ratio per sample of each parameter; errors last ``hold`` samples."""
    rng = np.random.default_rng(seed)
    columns = np.zeros((16, COUNT, 6))
    columns[:10] = (
        np.asarray(seen)[:, None, None] / UNITS[:, None, None] * rng.normal(size=(10, COUNT // 100, 6)).repeat(100, 1)
    )
    noise = rng.normal(size=(COUNT // hold, 6)).repeat(hold, 0)
    truth = np.r_[np.asarray(physical.theta_of(sheet)), np.zeros(6)]
    at = np.asarray(physical.physical(jnp.asarray(X)))
    residual = np.einsum("ptc,p->tc", columns, at - truth) + noise
    flat = columns.reshape(16, -1)
    return Linear(at, columns, residual, flat @ flat.T, *np.zeros((3, 6)))


def judged(*arguments, **options):
    return shown.judge(shown.in_blocks(linear_of(*arguments, **options), DTS), X, PRIOR, STATED[4:])


def sheet_of(found):
    return np.asarray(physical.data_sheet(physical.physical(jnp.asarray(found.x))[:10]))


def test_blocks_add_up_to_the_log():
    linear = linear_of(HEAVY, np.ones(10))
    parts = shown.in_blocks(linear, DTS)
    assert len(parts) == 9  # 40 s in blocks of 4 s, the last stamp at 39.99 s
    np.testing.assert_allclose(physical.total(parts).information, linear.information)
    np.testing.assert_allclose(physical.total(parts).constant, (linear.residual**2).sum() / 2)


@pytest.mark.parametrize(("hold", "expected"), [(1, 1.0), (100, 100.0)])
def test_errors_that_hang_together_are_told_by_the_scatter_of_blocks(hold, expected):
    found = [
        shown.overdispersion(shown.in_blocks(linear_of(STATED, np.ones(10), hold, seed), DTS), X, PRIOR)
        for seed in range(5)
    ]
    assert 0.5 * expected < np.mean(found) < 1.7 * expected


def test_what_is_shown_is_found():
    found = judged(HEAVY, np.full(10, 2.0))
    assert found.inertia
    assert found.kept == found.poor == ()
    assert found.gain[0] > 100
    assert (np.abs(sheet_of(found) - HEAVY) < [5e-3, *[1e-3] * 3, *[1e-4] * 6]).all()


def test_what_does_not_show_stays_and_the_rest_is_found():
    found = judged(HEAVY, np.r_[np.full(4, 2.0), np.full(6, 1e-4)])
    assert not found.inertia
    assert set(found.kept) == set(physical.NAMES[4:])
    sheet = sheet_of(found)
    np.testing.assert_allclose(sheet[:4], HEAVY[:4], atol=0.01)
    np.testing.assert_allclose(sheet[4:], STATED[4:], atol=1e-6)  # as identify writes it
    found = judged(HEAVY, np.r_[2.0, 2.0, 2.0, 1e-5, np.full(6, 1e-4)])
    assert "com_z" in found.kept
    np.testing.assert_allclose(sheet_of(found)[3], STATED[3], atol=1e-9)
    np.testing.assert_allclose(sheet_of(found)[0], HEAVY[0], atol=0.01)


def test_the_stated_inertia_is_judged_as_it_would_be_written():
    larger = STATED * np.r_[1.5, 1, 1, 1, np.full(6, 1.5)]  # the inertia per kg is as stated, and is not written
    found = judged(larger, np.full(10, 0.3))
    assert found.inertia
    assert found.gain[0] > 20


def test_an_inertia_that_is_right_as_stated_is_left_alone():
    for seed in range(5):
        found = judged(STATED, np.full(10, 0.3), seed=seed)
        assert not found.inertia
        assert found.poor == ()


def test_evidence_that_one_fast_part_of_the_log_has_for_the_most_is_evidence():
    """All blocks gain, one of them fifty times as much as the others: the scatter of the gains exceeds their mean."""
    linear = linear_of(HEAVY, np.full(10, 0.5))
    louder = np.where(np.arange(COUNT) // 500 == 3, 30.0, 1.0)[:, None]
    at, truth = linear.at, np.r_[np.asarray(physical.theta_of(HEAVY)), np.zeros(6)]
    signal = np.einsum("ptc,p->tc", linear.columns, at - truth)
    columns, residual = linear.columns * louder, linear.residual + signal * (louder - 1)
    flat = columns.reshape(16, -1)
    parts = shown.in_blocks(linear._replace(columns=columns, residual=residual, information=flat @ flat.T), DTS)
    found = shown.judge(parts, X, PRIOR, STATED[4:])
    assert 0 < found.gain[0] < shown.STANDARD_ERRORS * found.gain[1]
    assert found.inertia


def test_a_combination_that_does_not_show_leaves_both_parameters_open():
    direction = np.r_[0, 1 / UNITS[1], 1 / UNITS[2], np.zeros(7)]
    information = 1e4 * np.diag(np.r_[UNITS**-2.0, np.zeros(6)])
    information[1:3, 1:3] = 0
    information[:10, :10] += 1e4 * np.outer(direction, direction)
    assert shown.undetermined(information, UNITS) == ("com_x", "com_y")
    assert shown.undetermined(information, UNITS, alone=True) == ()
