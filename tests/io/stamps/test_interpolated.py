"""Readings that were interpolated onto the rows of a table are recovered, and no other rows are mistaken for them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ftbias_jax.io import log_of_arrays
from ftbias_jax.io.stamps.interpolated import find_readings, readings_only

SECONDS = 20.0


def arm(t, seed=0):
    """(T, 3) rad of swinging joints."""
    phase = np.random.default_rng(seed).uniform(0, 6, 3)
    return np.array([0.5, 0.8, 0.4]) * np.sin(np.array([1.3, 2.0, 3.1]) * t[:, None] + phase)


def wrench(t, seed=0):
    """(T, 6) N, Nm of a sensor with noise."""
    return 10 * arm(t, seed)[:, [0, 1, 2, 0, 1, 2]] + 0.05 * np.random.default_rng(seed).normal(size=(len(t), 6))


def interpolated(signal, rate, table_rate, seed=0):
    """Stamps (T,) of a table, its values (T, k), and the times (R,) s of the readings."""
    taken, t = np.arange(0, SECONDS, 1 / rate), np.arange(0, SECONDS - 2 / rate, 1 / table_rate)
    return t, np.stack([np.interp(t, taken, x) for x in signal(taken, seed).T], 1), taken


WRITTEN = {
    "in full": lambda x: x,
    "with 6 decimals": lambda x: np.round(x, 6),
    "in single precision": lambda x: x.astype(np.float32).astype(float),
    "with 6 digits": lambda x: np.vectorize(lambda number: float(f"{number:.6g}"))(x),
}


@pytest.mark.parametrize("written", WRITTEN)
@pytest.mark.parametrize("rate", [20.0, 47.0, 100.0, 130.0])
@pytest.mark.parametrize("signal", [arm, wrench])
def test_the_rows_nearest_to_the_readings_are_found(signal, rate, written):
    t, values, taken = interpolated(signal, rate, 500.0)
    rows = find_readings(t, WRITTEN[written](values))
    assert abs(len(rows) - len(taken)) < 0.03 * len(taken) + 3
    off = np.abs(t[rows][:, None] - taken).min(1)
    assert (off < 0.6 / 500).mean() > 0.8
    assert (off < 1.05 / 500).mean() > 0.97


@pytest.mark.parametrize("every", [2, 5])
def test_readings_that_are_rows_are_found_to_the_last_bit(every):
    t = np.arange(0, SECONDS, 1 / 250)
    taken = t[::every]
    values = np.stack([np.interp(t, taken, x) for x in wrench(taken).T], 1)
    found, (repair,) = readings_only(t, {"wrench": values, "q": arm(t)})
    kept = ~np.isnan(found["wrench"]).all(1)
    np.testing.assert_array_equal(np.flatnonzero(kept), np.arange(len(taken)) * every)
    assert repair.what.startswith("the wrench was interpolated between readings")
    assert not repair.lost
    np.testing.assert_array_equal(found["q"], arm(t))


@given(
    seed=st.integers(0, 10**6),
    rate=st.sampled_from([20.0, 125.0, 500.0, 1000.0]),
    noise=st.sampled_from([0.0, 1e-6, 1e-4]),
    digits=st.sampled_from([2, 3, 4, 6, 15]),
)
def test_joints_as_they_were_read_are_kept(seed, rate, noise, digits):
    """For any rate, noise and resolution; in motion and at rest, and held for several rows."""
    t = np.arange(0, SECONDS, 1 / rate)
    q = arm(t, seed) + noise * np.random.default_rng(seed).normal(size=(len(t), 3))
    q[t > 12] = q[np.searchsorted(t, 12)]
    q = np.round(q, digits)
    assert find_readings(t, q) is None
    assert find_readings(t, q[np.arange(len(t)) // 4 * 4]) is None


@given(seed=st.integers(0, 10**6))
def test_a_trajectory_of_constant_speeds_and_accelerations_is_kept(seed):
    """Commanded joints have no noise, and move along straight lines most of the time."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, SECONDS, 0.004)
    corners = np.sort(rng.uniform(0, SECONDS, (3, 12)))
    speeds = rng.uniform(-1, 1, (3, 12)) * (rng.uniform(size=(3, 12)) < 0.7)
    q = 0.004 * np.stack([np.cumsum(np.interp(t, *one)) for one in zip(corners, speeds, strict=True)], 1)
    assert find_readings(t, q) is None


def test_an_arm_that_speeds_up_once_and_is_driven_on_is_kept():
    """The path is one long bend between two straight lines."""
    t = np.arange(0, 4, 0.004)
    q = 0.004 * np.cumsum(np.clip(4 * (t - 1), 0, 1))[:, None]
    assert find_readings(t, q) is None


def test_an_arm_at_rest_is_read_as_often_as_in_motion():
    t, q, _ = interpolated(arm, 50.0, 500.0)
    still = (t > 8) & (t < 12)
    q[still] = q[np.argmax(still)]
    rows = find_readings(t, q)
    assert np.diff(t[rows]).max() < 0.05


def test_what_is_missing_or_short_is_left_alone():
    t, q, _ = interpolated(arm, 50.0, 500.0)
    assert find_readings(t[:300], q[:300]) is None
    assert find_readings(t, np.full_like(q, np.nan)) is None
    sparse = np.full_like(q, np.nan)
    sparse[::10] = arm(t[::10])
    assert find_readings(t, sparse) is None


@pytest.mark.parametrize("form", ["s", "ns"])
def test_a_log_has_what_was_read(setup, form):
    t, q, taken = interpolated(arm, 47.0, 500.0)
    stamps = t if form == "s" else np.rint(1e9 * t).astype(np.int64)
    log = log_of_arrays(setup, stamps, q[:, :2], wrench(t))
    kept = ~np.isnan(log.q).any(1)
    assert abs(kept.sum() - len(taken)) < 5
    np.testing.assert_allclose(log.q[kept], arm(log.t[kept])[:, :2], rtol=0, atol=2e-4)
    assert not np.isnan(log.wrench).any()
    assert [repair.lost for repair in log.repairs] == [False]
