"""Contacts get the ends that the samples show, and bins in which a tool grinds count for less."""

import numpy as np
import pytest

from ftbias_jax.diagnosis.samples.touched import variance_in_contact, with_exact_ends
from ftbias_jax.filtering.noise.contact import Contact

NOISE = np.repeat([0.1, 0.004], 3)
PUSH = np.array([-3.0, 1.0, 12.0, 0.0, 0.0, 0.0])
T = np.arange(0.0, 40.0, 0.002)


def errors(rng, force, begin=12.003, end=27.31, ramp=1e-6):
    on = np.clip(np.minimum((T - begin) / ramp, (end - T) / ramp), 0, 1)
    drift = 0.01 * (T[:, None] - 20.0)
    return NOISE * rng.normal(size=(len(T), 6)) + drift + on[:, None] * force


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("ramp", "most"), [(1e-6, 0.003), (0.1, 0.03)])
def test_ends_that_a_filter_finds_to_a_block_are_found_to_the_sample(seed, ramp, most):
    rng = np.random.default_rng(seed)
    rough = Contact(*(np.array([12.003, 27.31]) + rng.uniform(-0.15, 0.15, 2)), PUSH)
    (contact,) = with_exact_ends(T, errors(rng, PUSH, ramp=ramp), [rough])
    np.testing.assert_allclose((contact.start, contact.end), (12.003, 27.31), atol=most)


def test_ends_at_the_ends_of_the_log_stay():
    rng = np.random.default_rng(0)
    whole = Contact(0.0, T[-1], PUSH)
    assert with_exact_ends(T, errors(rng, PUSH, begin=-1.0, end=50.0), [whole]) == (whole,)
    missing = np.where((T < 5)[:, None], errors(rng, PUSH), np.nan)
    rough = Contact(12.0, 27.3, PUSH)
    assert with_exact_ends(T, missing, [rough]) == (rough,)


def bins(x):
    return x.reshape(-1, 10, *x.shape[1:]).mean(1)


@pytest.mark.parametrize("chatter", [0.0, 2.0])
def test_chatter_in_contact_is_measured_and_a_smooth_push_has_none(chatter):
    rng = np.random.default_rng(1)
    force = PUSH * (1 + 0.2 * np.sin(2 * np.pi * 0.5 * T))[:, None]
    rattle = chatter * np.repeat(rng.normal(size=(len(T) // 10, 6)), 10, 0)
    t, error = bins(T), bins(errors(rng, force + rattle))
    variance = np.broadcast_to(NOISE**2 / 10, error.shape)
    more = variance_in_contact(t, error, variance, [Contact(12.003, 27.31, PUSH)])
    middle, free = (t > 12.1) & (t < 27.2), (t < 11.9) | (t > 27.4)
    assert not more[free].any()
    np.testing.assert_allclose(more[middle], chatter**2, rtol=0.25)


def test_bins_in_which_a_contact_begins_or_ends_may_be_anything_between():
    t, error = bins(T), bins(errors(np.random.default_rng(2), PUSH))
    more = variance_in_contact(t, error, np.broadcast_to(NOISE**2 / 10, error.shape), [Contact(12.003, 27.31, PUSH)])
    for end in (12.003, 27.31):
        assert more[np.abs(t - end).argmin(), 2] > 0.9 * PUSH[2] ** 2
    assert (more[:, 2] > 0).sum() <= 8


def test_a_contact_from_the_first_to_the_last_bin():
    t, error = bins(T), bins(errors(np.random.default_rng(4), PUSH, begin=-1.0, end=50.0))
    whole = [Contact(float(t[0]), float(t[-1]), PUSH)]
    assert (variance_in_contact(t, error, np.broadcast_to(NOISE**2 / 10, error.shape), whole) < 0.1).all()


def test_a_log_without_contact_is_left_as_it_is():
    error = errors(np.random.default_rng(3), 0 * PUSH)
    assert with_exact_ends(T, error, []) == ()
    assert not variance_in_contact(bins(T), bins(error), np.ones_like(bins(error)), []).any()
