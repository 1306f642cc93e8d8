"""Noise of a log beyond its setup, from synthetic blocks."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made_series import STD, blocks_of, free_motion, gauss_markov, made_blocks, stamps

from ftbias_jax.filtering.noise.blocks import Layout
from ftbias_jax.filtering.noise.contact import Contact
from ftbias_jax.filtering.noise.fit_noise import (
    drop_zero_terms,
    fit_noise,
    from_median,
    is_white,
    offset_of,
    with_noise,
)
from ftbias_jax.filtering.noise.fit_noise import inflation as jax_inflation
from ftbias_jax.filtering.noise.levels import slow_std
from ftbias_jax.filtering.noise.log_noise import LogNoise, describe, log_noise_from, nothing, remarks_of_noise
from ftbias_jax.filtering.noise.slow_noise import SlowNoise
from ftbias_jax.filtering.noise.vibration import Shares, Vibration

T, LAYOUT = stamps(60, 20), Layout(25, 0.05)
inflation = jax.jit(jax_inflation)
_fit = jax.jit(fit_noise, static_argnums=2)


def noise_of_log(blocks, stated, layout=LAYOUT):
    """Noise of a log in the form that is reported to users."""
    found = jax.tree.map(np.asarray, _fit(stated, blocks, layout)[1])
    return log_noise_from(found, layout, slow_is_stated=stated.correlated_std is not None)


def no_joints(blocks):
    """Blocks of an arm at rest with as many joints as the stated one."""
    return blocks._replace(motion=np.zeros((len(blocks.t), 3)))


@pytest.fixture(scope="module")
def stated(params):
    """Parameters of a filter whose prior and noise match the synthetic series."""
    bias = params.bias._replace(
        density=jnp.asarray(0.01 * STD),
        wrench_variance=jnp.asarray(STD**2),
        prior_mean=jnp.zeros(12),
        prior_std=jnp.asarray(np.concatenate([30 * STD, 0.1 * STD])),
    )
    return bias


def white_blocks(seed, slow=0.0, time=1.0, count=25):
    rng = np.random.default_rng(seed)
    y = free_motion(rng, T, STD / np.sqrt(count)) + gauss_markov(rng, T, slow * STD, time)
    blocks = no_joints(made_blocks(T, y, STD**2, count))
    dof = count - 2
    return blocks._replace(scatter=STD**2 * rng.gamma(dof / 2, 2 / dof, y.shape))


def test_white_innovations_inflate_nothing():
    """Factors begin beyond two standard deviations, so on six axes and three lengths a few exceed 1 slightly."""
    series = [np.random.default_rng(seed).normal(size=(len(T), 6)) for seed in range(50)]
    factors = np.array([inflation(T, x) for x in series])
    assert (factors >= 1).all()
    assert (factors == 1).mean() > 0.85
    assert factors.max() < 2
    white = [bool(is_white(x)) for x in series] & (factors == 1).all(1)
    assert white.mean() > 0.4  # the others are searched for slow errors, without finding any


def test_correlated_innovations_inflate_by_what_their_means_scatter_more():
    rng = np.random.default_rng(0)
    t = stamps(600, 20)
    white = gauss_markov(rng, t, np.ones(6), 0.5)
    # The mean of many samples of such noise has the variance of white noise times (1 + f) / (1 - f).
    kept = np.exp(-0.05 / 0.5)
    np.testing.assert_allclose(inflation(t, white), np.sqrt((1 + kept) / (1 - kept)), rtol=0.25)
    assert not is_white(white)


def test_one_axis_inflates_itself_alone():
    white = np.random.default_rng(1).normal(size=(len(T), 6))
    white[:, 3] += np.sin(0.5 * T)
    white[::3, 3] = np.nan
    factor = inflation(T, white)
    assert factor[3] > 1.5
    assert (np.delete(factor, 3) < 1.4).all()
    assert (factor > 1).any()


def test_what_the_setup_states_is_kept(stated):
    bias = stated._replace(
        vibration=jnp.zeros((3, 6)), correlated_std=jnp.asarray(STD), correlated_time=jnp.full(6, 1.0)
    )
    noise = noise_of_log(white_blocks(0, slow=1.0), bias)
    assert not noise.vibration.taken
    assert noise.slow is None
    assert (noise.inflation < 1.6).all()


def test_a_sharp_prior_far_from_zero_is_no_error_of_the_model(stated):
    blocks = white_blocks(0, slow=1.0)
    blocks = blocks._replace(mean=blocks.mean - blocks.mean.mean(0))
    here = 3000 * STD
    moved = blocks._replace(mean=blocks.mean + here)
    sharp = stated.prior_std.at[:6].set(jnp.asarray(0.5 * STD))
    known = stated._replace(prior_mean=jnp.asarray(np.concatenate([here, np.zeros(6)])), prior_std=sharp)
    noise = noise_of_log(moved, known)
    expected = noise_of_log(blocks, stated._replace(prior_std=sharp))
    assert (expected.slow.std > 0).all()
    np.testing.assert_allclose(noise.slow.std, expected.slow.std, rtol=1e-6)
    np.testing.assert_allclose(noise.slow.time, expected.slow.time, rtol=1e-6)
    np.testing.assert_allclose(noise.inflation, expected.inflation, rtol=1e-6)
    assert not noise.offset.any()


def test_what_slow_errors_are_usually_off_is_no_offset(stated):
    blocks = white_blocks(0, slow=1.0)
    blocks = blocks._replace(mean=blocks.mean - blocks.mean.mean(0))
    sharp = stated.prior_std.at[:6].set(jnp.asarray(0.01 * STD))
    first = blocks.mean[:5].mean(0)
    assert (np.abs(first) > 4 * 0.01 * STD).any()
    assert not offset_of(blocks, slow_std(blocks, LAYOUT), stated._replace(prior_std=sharp)).any()


@pytest.mark.parametrize("missing", [[2], [0, 4], list(range(6))])
def test_axes_that_were_never_measured_do_not_matter(stated, missing):
    t = stamps(20, 250)
    y = free_motion(np.random.default_rng(2), t)
    y[:, missing] = np.nan
    blocks, layout = blocks_of(t, y, velocity=np.zeros((len(t), 3)))
    noise = noise_of_log(blocks, stated, layout)
    assert noise.contacts == ()
    assert all(np.isfinite(x).all() for x in (noise.offset, noise.inflation, noise.vibration.level))
    assert (noise.inflation[missing] == 1).all()
    assert not noise.offset[missing].any()


def test_an_offset_of_kilonewtons_widens_the_prior(stated):
    """Readings are kept; otherwise the filter would reject them as contact for ever. What moved two axes moved all."""
    blocks = white_blocks(3)
    shift = np.array([12.8e3, 0, 0, 0, -7.0, 0])
    shifted = blocks._replace(mean=blocks.mean + shift)
    offset = np.asarray(offset_of(shifted, slow_std(shifted, LAYOUT), stated))
    assert (offset != 0).all()
    np.testing.assert_allclose(offset, shift, atol=80 * STD.max())
    noise = noise_of_log(shifted, stated)
    assert noise.contacts == ()
    filtered_with, _ = _fit(stated, shifted, LAYOUT)
    prior = np.asarray(filtered_with.prior_std)
    np.testing.assert_allclose(prior[:6], np.maximum(30 * STD, np.abs(offset)))
    np.testing.assert_array_equal(prior[6:], stated.prior_std[6:])
    assert not offset_of(blocks, slow_std(blocks, LAYOUT), stated).any()


AS_STATED = Shares(*np.ones((2, 6)))


def full():
    """Noise of a log with everything that can be found."""
    per_speed = np.outer([1.0, 0, 2.0], STD**2)
    level = np.array([1, 2.25, 1, 1, 1, 1])
    slow = SlowNoise(np.array([0.3, 0, 0, 0, 0, 0.01]), np.array([0.5, 1, 1, 1, 1, 2.0]), np.full(6, 20.0))
    offset, factor = np.array([12800.0, 0, 0, 0, 0, 0]), np.array([1, 1, 1.7, 1, 1, 1])
    contact = Contact(3.0, 4.5, np.array([3.0, 4, 0, 0, 0, 0]))
    vibration = Vibration(level, per_speed, np.asarray(0.1), 50.0, AS_STATED, True)
    return LogNoise((contact,), vibration, slow, offset, factor, density=np.array([0, 0.4, 0, 0, 0, 0]))


def test_parameters_take_what_the_log_shows(stated):
    noise = full()
    bias = with_noise(stated, noise)
    np.testing.assert_allclose(bias.wrench_variance, STD**2 * noise.vibration.level)
    np.testing.assert_allclose(bias.vibration, noise.vibration.per_speed)
    assert float(bias.vibration_speed) == pytest.approx(0.1)
    np.testing.assert_allclose(bias.correlated_std, noise.slow.std)
    np.testing.assert_allclose(bias.correlated_time, noise.slow.time)
    np.testing.assert_allclose(bias.density, np.maximum(stated.density, noise.density))
    assert all(x.dtype == stated.density.dtype for x in jax.tree.leaves(bias))


def test_parameters_keep_the_stated_noise_where_the_log_has_less(stated):
    noise = full()
    quieter = noise._replace(vibration=noise.vibration._replace(level=np.full(6, 0.25)))
    np.testing.assert_array_equal(with_noise(stated, quieter).wrench_variance, stated.wrench_variance)


def test_a_reader_is_told_what_the_log_shows():
    lines = describe(full())
    assert [line.split(":")[0] for line in lines] == [
        "the bias at the start is far from what the setup expects, by N, Nm",
        "contact from 3.00 to 4.50 s, up to 5 N",
        "the noise grows with the speed of the motion; the filter takes what the scatter of the log shows",
        "scatter of single readings at rest, per stated noise_std",
        "errors that vary slowly (N, Nm and correlation time)",
        "the bias wanders more than stated, noise_density in N/s^1.5, Nm/s^1.5",
        "standard deviations of the bias are enlarged, by what the innovations still contradict",
    ]
    assert "1.28e+04" in lines[0]
    assert lines[3].endswith(" 1.5")
    assert "0.3 over 0.5 s" in lines[4]
    assert "0.01 over 2 s" in lines[4]
    assert lines[5].endswith(": fy 0.4")
    assert lines[6].endswith(" 1.7")


def test_noise_that_is_zero_is_left_out(stated):
    quiet = stated._replace(correlated_std=np.zeros(6), correlated_time=np.ones(6), vibration=np.zeros((3, 6)))
    assert drop_zero_terms(quiet._replace(vibration_speed=np.array(0.1))) == stated
    bent = stated._replace(vibration=np.ones((3, 6)), vibration_speed=np.array(np.inf))
    assert drop_zero_terms(bent).vibration_speed is None
    assert drop_zero_terms(bent).vibration is bent.vibration


def test_a_bias_that_begins_again_begins_at_the_median_of_what_is_free(stated):
    blocks = white_blocks(5)
    mean = blocks.mean + np.where((T > 10) & (T < 12), 100.0, 0.0)[:, None] * [1, 1, 1, 0, 0, 0]
    mean[:, 4] = np.nan
    blocks = blocks._replace(mean=mean)
    _, found = _fit(stated, blocks, LAYOUT)
    begun = from_median(stated, found, blocks)
    free = ~np.asarray(found.contacts.inside)
    assert 0.9 * len(T) < free.sum() < 0.98 * len(T)
    axes = [0, 1, 2, 3, 5]
    median = np.median(mean[free][:, axes], 0)
    np.testing.assert_allclose(np.asarray(begun.prior_mean)[axes], median)
    scatter = 1.4826 * np.median(np.abs(mean[free][:, axes] - median), 0)
    np.testing.assert_allclose(np.asarray(begun.prior_std)[axes], scatter)
    assert (begun.prior_mean[4], begun.prior_std[4]) == (stated.prior_mean[4], stated.prior_std[4])
    np.testing.assert_array_equal(begun.prior_std[6:], stated.prior_std[6:])


def test_the_owner_is_told_of_a_gate_that_keeps_out_most_of_a_log():
    assert describe(nothing()) == []
    assert remarks_of_noise(nothing()) == ()
    (begun,) = remarks_of_noise(nothing()._replace(begun_again=True))
    assert not begun.lost
    _, kept_out = remarks_of_noise(nothing()._replace(begun_again=True, kept_out=0.76))
    assert kept_out.lost
    assert "76%" in kept_out.what
