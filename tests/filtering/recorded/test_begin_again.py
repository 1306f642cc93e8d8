"""A gate that keeps out most of a log: the bias begins anew, and the owner is told."""

from types import SimpleNamespace

import numpy as np
import pytest
from made_series import STD, made_blocks, stamps

from ftbias_jax.filtering.adapt.contact import Contact
from ftbias_jax.filtering.adapt.log_noise import describe, nothing
from ftbias_jax.filtering.recorded.begin_again import filter_or_begin_again, from_median, remark_of_gate

T = stamps(10, 20)
LEVEL = np.array([1.0, -2, 30, 0.1, 0, -0.2])


@pytest.fixture(scope="module")
def blocks():
    """Means of 10 s about a level, with an odd first half second."""
    mean = LEVEL + 0.1 * STD * np.random.default_rng(0).normal(size=(len(T), 6))
    mean[T < 0.5] += 100 * STD
    return made_blocks(T, mean, STD**2)


def filtered(params, blocks, shares, noise=None):
    """What comes out if the runs use these shares of 100 samples, and the parameters of every run."""
    taken, shares = [], iter(shares)

    def run(params):
        taken.append(params)
        share = next(shares)
        return iter([SimpleNamespace(used=np.arange(100) < 100 * share)])

    part = SimpleNamespace(
        samples=SimpleNamespace(wrench=np.ones((100, 6))), log=SimpleNamespace(t=np.arange(100) / 10)
    )
    return *filter_or_begin_again(params, nothing() if noise is None else noise, blocks, [part], run), taken


def test_a_gate_that_keeps_half_is_left_alone(params, blocks):
    after, noise, (part,), taken = filtered(params, blocks, [0.5])
    assert after is params
    assert len(taken) == 1
    assert part.used.sum() == 50
    assert describe(noise) == []
    assert remark_of_gate(noise) == ()


def test_otherwise_the_bias_begins_at_the_median_and_that_is_told(params, blocks):
    after, noise, (part,), taken = filtered(params, blocks, [0.02, 0.97])
    assert len(taken) == 2
    assert after is taken[1]
    assert part.used.sum() == 97
    np.testing.assert_allclose(after.bias.prior_mean[:6], LEVEL, atol=0.1 * STD.max())
    (told,) = remark_of_gate(noise)
    assert "the bias begins at its median" in told.what
    assert not told.lost
    assert describe(noise) == [told.what]


def test_a_gate_that_still_keeps_most_out_is_a_warning(params, blocks):
    _, noise, (part,), _ = filtered(params, blocks, [0.02, 0.3])
    assert part.used.sum() == 30
    first, second = remark_of_gate(noise)
    assert (first.lost, second.lost) == (False, True)
    assert second.what.startswith("the gate keeps out 70% of the log")


def test_a_start_that_lets_even_less_through_is_not_taken(params, blocks):
    after, noise, (part,), _ = filtered(params, blocks, [0.02, 0.01])
    assert after is params
    assert part.used.sum() == 2
    (told,) = remark_of_gate(noise)
    assert told.lost


def test_contacts_do_not_count_as_kept_out(params, blocks):
    noise = nothing()._replace(contacts=(Contact(2.0, 9.0, np.ones(6)),))
    _, _, _, taken = filtered(params, blocks, [0.25], noise)
    assert len(taken) == 1


def test_the_median_is_that_of_free_motion_and_as_uncertain_as_the_log_scatters(params, blocks):
    pushed = blocks._replace(mean=blocks.mean + np.where((T > 2) & (T < 9), 5.0, 0)[:, None])
    noise = nothing()._replace(contacts=(Contact(1.95, 9.05, np.ones(6)),))
    bias = from_median(params, noise, pushed).bias
    np.testing.assert_allclose(bias.prior_mean[:6], LEVEL, atol=0.2 * STD.max())
    assert (np.asarray(bias.prior_std[:6]) < STD).all()
    np.testing.assert_array_equal(bias.prior_mean[6:], params.bias.prior_mean[6:])


def test_an_axis_that_was_never_measured_keeps_its_prior(params, blocks):
    missing = blocks._replace(mean=np.where(np.arange(6) == 2, np.nan, blocks.mean))
    bias = from_median(params, nothing(), missing).bias
    assert bias.prior_mean[2] == params.bias.prior_mean[2]
    assert bias.prior_std[2] == params.bias.prior_std[2]
