"""Sensors that are set to zero while they record: the bias jumps where the setup states it, and nowhere else."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_checks import BIAS, right_log

import ftbias_jax as ft
from ftbias_jax.filtering import likelihood, pipeline
from ftbias_jax.filtering.samples import pad, samples_from_log
from ftbias_jax.io.cleaning import slices
from ftbias_jax.model.params import params_from_setup

JUMPS = (800, 1300)


def zeroed_log(rows=JUMPS, start=100.0):
    """Tables and arrays of a log that is set to zero at some samples; the true bias (T, 6) and the times of zeroing."""
    tables, arrays = right_log(seed=9, duration=20.0)
    tables["joints"]["process_noise_density"] = 5.0
    tables["bias"] = {"initial_std": [5.0, 0.5]}
    bias = np.tile(BIAS, (len(arrays["t"]), 1))
    wrench = arrays["wrench"].copy()
    for row in rows:
        bias[row:] += wrench[row]
        wrench[row:] -= wrench[row]
    times = [float(start + (arrays["t"][row - 1] + arrays["t"][row]) / 2) for row in rows]
    return tables, {**arrays, "t": arrays["t"] + start, "wrench": wrench}, bias, times


def stated(tables, times):
    return ft.parse_setup({**tables, "sensor": {**tables["sensor"], "rezeroed_at": times}})


@pytest.fixture(scope="module")
def zeroed():
    tables, arrays, bias, times = zeroed_log()
    setup = stated(tables, times)
    return setup, ft.Log.from_arrays(setup, **arrays), bias


@pytest.fixture(scope="module")
def filtered(zeroed):
    setup, log, _ = zeroed
    return ft.filter_log(setup, log, smooth=True)


def test_the_stamps_of_the_setup_are_those_of_the_log_and_come_with_every_part(zeroed):
    _, log, _ = zeroed
    whole = log.is_rezeroed(log.t)
    np.testing.assert_array_equal(np.flatnonzero(whole), JUMPS)
    for size in (1, 7, 800, 801):
        before, found = None, []
        for part in slices(log)(size):
            found.append(part.is_rezeroed(part.t, before))
            before = part.t[-1]
        np.testing.assert_array_equal(np.concatenate(found), whole)


def test_times_outside_of_a_log_and_padding_say_nothing(zeroed):
    _, log, _ = zeroed
    assert not log._replace(rezeroed_at=(-1.0, 0.0, 1e9)).is_rezeroed(log.t).any()
    last = log._replace(rezeroed_at=(float(log.t[-1]),))
    padded = pad(samples_from_log(last), len(log.t) + 5)
    np.testing.assert_array_equal(np.flatnonzero(padded.rezeroed), [len(log.t) - 1])


@pytest.mark.slow
def test_the_filter_finds_the_bias_again_behind_each_jump_and_its_error_bars_hold(zeroed, filtered):
    _, _, bias = zeroed
    off = (filtered.bias - bias) / filtered.bias_std
    assert np.abs(bias[JUMPS[0]] - BIAS)[:3].max() > 3  # otherwise there is nothing to find
    assert np.abs(off[50:]).max() < 5
    for row in JUMPS:
        assert np.abs(off[row - 100 : row + 100]).max() < 5
        # At the jump it is as good as from a few readings, and worse than before it.
        assert (filtered.bias_std[row] > 3 * filtered.bias_std[row - 1]).all()
    assert 0.2 < np.mean(off[50:] ** 2) < 2
    assert filtered.contacts == ()
    assert 0.9 < np.nanmean(filtered.nis) / 6 < 1.1


def test_the_smoother_knows_no_jump_beforehand(zeroed, filtered):
    _, _, bias = zeroed
    off = (filtered.bias_smooth - bias) / filtered.bias_smooth_std
    assert np.abs(off).max() < 5
    assert 0.2 < np.mean(off**2) < 2
    for row in JUMPS:
        beside = np.abs(np.diff(filtered.bias_smooth[row - 20 : row], axis=0)).max()
        assert np.abs(filtered.bias_smooth[row] - filtered.bias_smooth[row - 1]).max() > 30 * beside


def test_before_a_jump_nothing_is_changed_by_it(zeroed):
    """The filter as it runs on a robot, without future samples."""
    setup, log, _ = zeroed
    params = params_from_setup(setup)
    run = jax.jit(lambda samples: pipeline.run(params, pipeline.init(params, samples), samples)[1]["bias"])
    with_jump, without = (run(samples_from_log(x)) for x in (log, log._replace(rezeroed_at=(1e9,))))
    np.testing.assert_array_equal(with_jump[: JUMPS[0]], without[: JUMPS[0]])
    assert np.abs(with_jump - without)[JUMPS[0] :].max() > 1


def test_what_is_behind_a_jump_is_worth_nothing_before_it(zeroed):
    """Whitened, a step of the reading at the jump nearly vanishes; without the jump it is a large contradiction."""
    with jax.enable_x64(True):
        setup, log, _ = zeroed
        params, samples = params_from_setup(setup, jnp.float64), _short(log)
        state = pipeline.init(params, samples)
        joints = pipeline.run(params, state, samples, emit=pipeline.keep_all)[1][0].joint
        problem, _ = likelihood.wrench_problem(params, samples, joints)
        step = jnp.zeros((1, len(samples.dt), 6)).at[:, 30:].set(5.0)
        with_jump, without = (likelihood.whiten(x, step) for x in (problem, problem._replace(jump=None)))
        assert (with_jump**2).sum() < 0.05 * (without**2).sum()


def _short(log):
    """60 samples, of which the 30th is the first after a jump."""
    part = jax.tree.map(lambda x: jnp.asarray(x[JUMPS[0] - 30 : JUMPS[0] + 30]), samples_from_log(log))
    return part._replace(dt=part.dt.at[0].set(0.0))
