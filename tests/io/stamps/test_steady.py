"""Stamps that scatter are replaced by the underlying steady clock, where moving joints are smoother on it."""

import numpy as np
import pytest

from ftbias_jax.errors import LogError
from ftbias_jax.io import log_of_arrays
from ftbias_jax.io.stamps.steady import CLEAR, on_steady_clocks, scatters, steady

T, RATE = 4000, 250.0
NOISE = 2e-5


def arm(t, seed=0, noise=NOISE):
    """(T, 3) rad of swinging joints at times in s."""
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0, 2 * np.pi, 3)
    return 0.5 * np.sin(2 * np.pi * np.array([0.2, 0.35, 0.6]) * t[:, None] + phase) + noise * rng.normal(
        size=(len(t), 3)
    )


def late(t, rng):
    """Stamps of messages that are delayed without overtaking one another."""
    return np.maximum.accumulate(t + rng.exponential(0.1 / RATE, len(t))) + 1e-9 * np.arange(len(t))


def packets(t, rng):
    last = np.minimum(np.arange(len(t)) // 8 * 8 + 7, len(t) - 1)
    return t[last] + 1e-5 * (np.arange(len(t)) % 8)


SCATTERED = {
    "late": late,
    "packets of 8": packets,
    "about the time": lambda t, rng: t + rng.uniform(-0.2, 0.2, len(t)) / RATE,
}


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("form", "lost"), [*((form, 0.0) for form in SCATTERED), ("late", 0.03), ("about the time", 0.03)]
)
def test_the_clock_behind_stamps_that_scatter_is_found(form, seed, lost):
    rng = np.random.default_rng(seed)
    taken = np.arange(T) / RATE
    stamps, kept = SCATTERED[form](taken, rng), rng.uniform(size=T) >= lost
    stamps, taken = stamps[kept], taken[kept]
    assert scatters(stamps)
    clock = steady(stamps, arm(taken, seed))
    assert clock.gain > CLEAR
    off = (clock.t - taken)[:-8]  # the last ones may be late, or one was lost
    assert np.ptp(off) < 0.2 / RATE
    assert np.std(off) < 0.01 / RATE
    assert np.std(np.diff(off)) < 0.01 * np.std(np.diff(stamps - taken))


def test_which_reading_of_a_packet_was_lost_is_not_known_but_most_of_the_error_goes():
    rng = np.random.default_rng(0)
    kept, taken = rng.uniform(size=T) >= 0.03, np.arange(T) / RATE
    stamps, taken = packets(taken, rng)[kept], taken[kept]
    clock = steady(stamps, arm(taken))
    assert clock.gain > CLEAR
    assert np.std(clock.t - taken) < 0.2 * np.std(stamps - taken)


def test_stamps_rounded_to_milliseconds_of_a_rate_that_is_no_whole_number_of_them():
    taken = np.arange(T) / 400
    clock = steady(np.round(taken, 3), arm(taken))
    assert clock.gain > CLEAR
    np.testing.assert_allclose(np.diff(clock.t), 1 / 400, atol=4e-5)


def test_a_pause_begins_the_clock_anew():
    taken = np.concatenate([np.arange(T) / RATE, 40.0013 + np.arange(T) / RATE])
    stamps = taken + np.random.default_rng(0).uniform(0, 0.4, 2 * T) / RATE
    clock = steady(stamps, arm(taken))
    off = clock.t - taken
    assert max(np.std(off[:T]), np.std(off[T:])) < 0.05 / RATE


def test_readings_taken_when_their_stamps_say_keep_them():
    rng = np.random.default_rng(0)
    t = np.sort(np.arange(T) / RATE + rng.uniform(-0.2, 0.2, T) / RATE)
    columns = {"q": arm(t), "wrench": rng.normal(size=(T, 6))}
    [(stamps, _)], repairs = on_steady_clocks(t, columns)
    assert scatters(t)
    assert stamps is t
    assert not repairs


@pytest.mark.parametrize("samples", [300, T])
@pytest.mark.parametrize("seed", range(5))
def test_an_arm_at_rest_tells_nothing(samples, seed):
    rng = np.random.default_rng(seed)
    t = np.arange(samples) / RATE + rng.uniform(-0.2, 0.2, samples) / RATE
    _, repairs = on_steady_clocks(t, {"q": 1 + NOISE * rng.normal(size=(samples, 3))})
    assert not repairs


def test_stamps_that_do_not_scatter_are_not_looked_at():
    t = np.arange(T) / RATE
    lost = np.random.default_rng(0).uniform(size=T) < 0.9
    assert not scatters(t)
    assert not scatters(t[lost])
    assert not scatters(np.arange(100) ** 2.0)  # too few samples


@pytest.mark.parametrize("as_integers", [False, True])
def test_streams_with_clocks_of_their_own(setup, as_integers):
    rng = np.random.default_rng(0)
    joints, wrench = np.arange(T) / RATE, 0.0011 + np.arange(2 * T) / (2 * RATE)
    stamps = late(joints, rng), late(wrench, rng)
    if as_integers:
        stamps = tuple(np.rint(1e9 * t).astype(np.int64) + 1_700_000_000_000_000_000 for t in stamps)
    q = arm(joints)[:, :2]
    log = log_of_arrays(setup, stamps, q, rng.normal(size=(2 * T, 6)))
    assert [repair.what.split(" up to")[0] for repair in log.repairs] == [
        "stamps of the wrench",
        "stamps of the joints",
    ]
    rows = ~np.isnan(log.q).all(1)
    off, off_wrench = log.t[rows] - joints, log.t[~np.isnan(log.wrench).all(1)] - wrench
    assert np.std(off) < 0.02 / RATE
    assert abs(np.mean(off) - np.mean(off_wrench)) < 0.02 / RATE  # both are still of one clock
    np.testing.assert_array_equal(log.q[rows], q)


def test_rows_of_two_clocks_in_which_each_stream_repeats_its_last_reading_keep_their_stamps():
    rng = np.random.default_rng(0)
    joints, wrench = np.arange(T) / RATE, 0.0003 + np.arange(T) / 230
    t = np.union1d(joints, wrench)
    columns = {
        name: values[np.maximum(np.searchsorted(stamps, t, side="right") - 1, 0)]
        for name, stamps, values in (("q", joints, arm(joints)), ("wrench", wrench, rng.normal(size=(T, 6))))
    }
    [(stamps, _)], repairs = on_steady_clocks(t, columns)
    assert scatters(t)
    assert stamps is t
    assert not repairs


def test_a_wrench_in_packets_beside_joints_that_are_on_time(setup):
    rng = np.random.default_rng(0)
    taken = np.arange(T) / RATE
    stamps = taken, packets(taken + 0.0013, rng)
    log = log_of_arrays(setup, stamps, arm(taken)[:, :2], rng.normal(size=(T, 6)))
    assert [repair.what.split(" up to")[0] for repair in log.repairs] == ["stamps of the wrench"]
    np.testing.assert_allclose(log.t[~np.isnan(log.q).all(1)], taken, atol=1e-12)
    np.testing.assert_allclose(log.t[~np.isnan(log.wrench).all(1)][:-8], taken[:-8] + 0.0013, atol=0.05 / RATE)


def test_columns_that_are_missing_now_and_then_do_not_matter():
    rng = np.random.default_rng(0)
    taken = np.arange(T) / RATE
    wrench, temperature = rng.normal(size=(T, 6)), np.full(T, 20.0)
    wrench[::4] = np.nan
    columns = {"q": arm(taken), "dq": np.full((T, 3), np.nan), "wrench": wrench, "temperature": temperature}
    [(t, same)], repairs = on_steady_clocks(late(taken, rng), columns)
    assert [repair.what.split(" up to")[0] for repair in repairs] == ["stamps of the joints and the wrench"]
    assert np.std(t - taken) < 0.01 / RATE
    np.testing.assert_array_equal(same["wrench"], wrench)


def test_an_array_of_another_length_is_named():
    t = np.arange(T) / RATE + np.random.default_rng(0).uniform(0, 0.4, T) / RATE
    with pytest.raises(LogError, match="wrench: has shape"):
        on_steady_clocks(t, {"q": arm(t), "wrench": np.zeros((T - 1, 6))}, "log.npz")
