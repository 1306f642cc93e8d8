import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ftbias_jax.errors import LogError
from ftbias_jax.io.stamps.clock import (
    PAUSE,
    continue_after_jumps,
    jumps,
    longer_in_words,
    on_right_clock,
    put_in_order,
    rate_against,
    tidy,
)
from ftbias_jax.setup.recorded import LogSetup

STEP = 10_000_000


def steady(start=10**9, samples=20):
    return start + STEP * np.arange(samples)


def test_segments_follow_each_other_and_stay_together():
    """The clock of two streams is set back by 0.15 s at the same moment."""
    first, second = np.r_[steady(), steady() + 50], np.r_[steady() + 3, steady() + 60]
    (a, b), count = continue_after_jumps([first, second])
    assert count == 1
    np.testing.assert_array_equal(a[:20], first[:20])
    assert a[20] - b[19] == PAUSE  # the second stream ends last, the first begins first
    np.testing.assert_array_equal(b[20:] - a[20:], second[20:] - first[20:])
    assert not len(jumps(a))


def test_streams_that_disagree_about_jumps_are_refused():
    with pytest.raises(LogError, match="jumps back 1 and 0 times") as caught:
        continue_after_jumps([np.r_[steady(), steady()], steady()], "log.bag")
    assert str(caught.value).startswith("log.bag: t_joints, t_wrench: ")


@given(st.lists(st.tuples(st.integers(0, 8), st.floats(-9, 9) | st.just(np.nan)), min_size=1, max_size=30))
def test_tidy_against_the_plain_loop(samples):
    t, values = np.array([s[0] for s in samples]), np.array([[s[1], 1.0] for s in samples])
    expected = {}
    for stamp, row in zip(t.tolist(), values, strict=True):
        kept = expected.setdefault(stamp, np.full(2, np.nan))
        kept[:] = np.where(np.isnan(kept), row, kept)
    result = tidy(t, {"x": values})
    assert result.t.tolist() == sorted(expected)
    np.testing.assert_array_equal(result.columns["x"], [expected[stamp] for stamp in result.t.tolist()])
    late = sum(stamp < max(t[: i + 1]) for i, stamp in enumerate(t))
    repeated = len(t) - len(expected)  # the second column collides in every repeated row
    told = [f"{late} of the samples came late"] * bool(late) + [f"{repeated} of the samples left out"] * bool(repeated)
    assert [repair.what.partition(":")[0] for repair in result.repairs] == told


@pytest.mark.parametrize("stamps", [steady()[::-1], np.r_[steady(), steady() + 5], np.r_[steady(), 0]])
def test_a_clock_that_was_set_back_is_no_late_sample(stamps):
    """This includes a clock that goes back in steps that are each small."""
    with pytest.raises(LogError, match=r"t: time does not increase: .* \(sort the samples, or cut the log where"):
        put_in_order(stamps, {"q": np.zeros(len(stamps))})


@pytest.mark.parametrize("rate", [-3000.0, -80.0, 250.0, 5000.0])
def test_stamps_of_a_clock_that_runs_fast_are_put_right(rate):
    """Stamps in s and in ns since 1970; only the wrench is corrected, including its offset."""
    true = np.linspace(0, 300, 30001)
    log = LogSetup(clocks={"wrench_rate": rate}, time_offsets={"wrench": -0.25})
    stamps = true * (1 + 1e-6 * rate) + 0.25
    np.testing.assert_allclose(on_right_clock(stamps, log, "wrench"), true, atol=300 * (1e-6 * rate) ** 2 + 1e-9)
    np.testing.assert_array_equal(on_right_clock(stamps, log, "position"), stamps)
    since_1970 = 1_700_000_000 * 10**9
    whole = since_1970 + np.rint(stamps * 1e9).astype(np.int64)
    right = on_right_clock(whole, log, "wrench")
    assert right.dtype == np.int64
    np.testing.assert_allclose((right - since_1970) * 1e-9, true, atol=300 * (1e-6 * rate) ** 2 + 2e-9)


@given(rate=st.floats(-5000, 5000), seed=st.integers(0, 2**16))
def test_the_rate_of_a_clock_is_that_of_the_shortest_waits(rate, seed):
    rng = np.random.default_rng(seed)
    true = np.arange(20_000) * 0.002
    logged = true + 1e-3 + rng.exponential(2e-3, len(true))
    stamps = true * (1 + 1e-6 * rate)
    found, stderr = rate_against(*(np.rint(t * 1e9).astype(np.int64) for t in (stamps, logged)))
    assert abs(found - rate) < 6 * stderr + 1e-6 * rate**2
    assert stderr < 5
    assert rate_against(np.arange(9), np.arange(9)) == (0.0, np.inf)


def test_the_ends_of_streams_that_began_together_tell_of_a_clock():
    joints = np.arange(0, 40, 0.002)
    fast = np.arange(0.001, 40, 0.004) * 1.002
    assert "wrench_rate = 1950 ± 100 (ppm)" in longer_in_words(joints, fast)
    for other in (fast / 1.002, fast + 3.0, fast[: len(fast) // 2], fast[:1]):
        assert longer_in_words(joints, other) == ""


@pytest.mark.parametrize(("start", "rate", "told"), [(86400.0, 100.0, True), (0.0, 1000.0, False), (1e9, 100.0, True)])
def test_stamps_of_single_precision_are_told_where_they_are_coarse(start, rate, told):
    """At the end of a day they are 8 ms apart; what they do to the intervals looks like jitter."""
    t = start + np.arange(2000) / rate
    rounded = t.astype(np.float32).astype(float)
    remarks = [repair.what for repair in put_in_order(rounded, {"q": np.zeros((2000, 2))}).repairs]
    assert any("single-precision" in what for what in remarks) == told
    assert not any("single" in repair.what for repair in put_in_order(t + 1e-4, {}).repairs)
