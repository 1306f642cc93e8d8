"""Held readings are found and used once, unlike those of a coarse sensor at rest; jitter and gaps are reported."""

import numpy as np
import pytest

from ftbias_jax.io import read_log
from ftbias_jax.io.cleaning import leave_out, slices, survey
from ftbias_jax.io.info import describe
from ftbias_jax.io.log import Log
from ftbias_jax.io.rates import (
    LEAST_SAMPLES,
    Repeats,
    extend_repeats,
    find_held,
    held_readings,
    jitter,
    missing_readings,
)

T = np.arange(2000) / 100


def arm(samples, rest=300, noise=0.3, step=0.0, speed=0.01, seed=0):
    """(T, 6) readings of an arm that stops and goes every ``rest`` samples, rounded to ``step``; 0 = not rounded."""
    rng = np.random.default_rng(seed)
    phase = np.cumsum(np.where((np.arange(samples) // rest) % 2, speed, 0.0))
    reading = 20 * np.sin(phase[:, None] * np.arange(1, 7) + np.arange(6)) + noise * rng.normal(size=(samples, 6))
    return np.round(reading / step) * step if step else reading


@pytest.mark.parametrize("samples", [2, 3, 4, 5, 10])
@pytest.mark.parametrize("step", [0.0, 0.3, 1.0])
def test_held_readings_are_found_and_every_one_is_kept_once(samples, step):
    readings = arm(2000, step=step)
    found = find_held(np.repeat(readings, samples, 0))
    assert found.samples == samples
    np.testing.assert_array_equal(found.repeats, np.arange(2000 * samples) % samples != 0)


@pytest.mark.parametrize("pattern", [(2, 3), (1, 1, 1, 2), (1, 2)])
def test_a_rate_that_is_no_multiple_of_the_sensors_is_found_too(pattern):
    found = find_held(np.repeat(arm(3000), np.resize(pattern, 3000), 0))
    assert found.samples == max(pattern)
    assert found.repeats.mean() == pytest.approx(1 - len(pattern) / sum(pattern), abs=0.01)


def test_of_readings_that_are_held_for_any_while_every_repeat_is_found():
    readings = np.random.default_rng(0).normal(size=(4000, 6))
    lengths = np.random.default_rng(1).choice([1, 2, 3, 4, 8], 4000, p=[0.69, 0.22, 0.04, 0.04, 0.01])
    found = find_held(np.repeat(readings, lengths, 0))
    assert (found.samples, found.repeats.sum()) == (8, (lengths - 1).sum())


@pytest.mark.parametrize("rest", [50, 100, 317, 1000, 5000])
@pytest.mark.parametrize("noise", [0.01, 0.05, 0.1, 0.3, 1.0])
@pytest.mark.parametrize("speed", [0.0005, 0.003, 0.01, 0.05])
def test_a_coarse_sensor_on_an_arm_that_rests_is_not_taken_for_held(rest, noise, speed):
    for samples in (2000, 20_000):
        assert find_held(arm(samples, rest, noise, 1.0, speed)) is None


def write(path, samples, joints=1):
    """A log at 500 Hz whose wrench is held for ``samples`` and whose joints are held for ``joints``."""
    rng = np.random.default_rng(1)
    t = np.arange(6000) * 0.002
    q = np.sin(t[:, None] * [1.0, 1.3]) + 1e-5 * rng.normal(size=(6000, 2))
    place = np.arange(6000)
    wrench = rng.normal(size=(6000, 6))[place - place % samples]
    np.savez(path, t=t, q=q[place - place % joints], dq=rng.normal(size=(6000, 2)), wrench=wrench)


def test_a_raw_log_keeps_held_readings_and_says_so(tmp_path, setup):
    """What is reported of the log without the repeats is tested in tests/faults/test_filtering.py."""
    write(tmp_path / "log.npz", 4, 2)
    raw = read_log(tmp_path / "log.npz", setup, raw=True)
    assert all(np.isfinite(values).all() for values in (raw.q, raw.dq, raw.wrench))
    assert [(repair.what, repair.lost) for repair in raw.repairs] == [
        ("the wrench is held for up to 4 samples, 4500 of 6000 repeat", False),
        ("the joints are held for up to 2 samples, 3000 of 6000 repeat", False),
    ]


def test_an_axis_that_is_stuck_in_a_held_log_is_found(tmp_path):
    values = np.repeat(arm(2000), 2, 0)
    values[1000:3000, 4] = 0.5
    nothing = np.full((4000, 1), np.nan)
    log = Log(np.arange(4000) * 0.002, nothing, nothing, values, nothing[:, 0])
    facts = survey(slices(log))
    assert [len(axis.stuck) for axis in facts.axes] == [0, 0, 0, 0, 1, 0]
    assert np.isnan(leave_out(log, facts).wrench[1::2]).all()


def test_info_tells_of_held_readings_and_of_stamps_that_scatter(tmp_path):
    write(tmp_path / "log.npz", 4, 2)
    joints, wrench = describe(tmp_path / "log.npz").streams
    assert "held: 75 % of the samples repeat the one before, one reading for up to 4 samples" in wrench.trouble
    assert "held: 50 % of the samples repeat the one before, one reading for up to 2 samples" in joints.trouble
    arrays = dict(np.load(tmp_path / "log.npz"))
    arrays["t"] = arrays["t"] + 5e-4 * np.random.default_rng(0).uniform(-1, 1, 6000)
    np.savez(tmp_path / "log.npz", **arrays)
    assert any("stamps scatter by 0." in trouble for trouble in describe(tmp_path / "log.npz").streams[1].trouble)


@pytest.mark.parametrize("std", [1e-3, 3e-3])
def test_the_standard_deviation_of_the_stamps_is_found(std):
    t = np.arange(20_000) * 0.01 + std * np.random.default_rng(0).normal(size=20_000)
    assert jitter(np.sort(t)) == pytest.approx(std, rel=0.1)


def test_a_steady_clock_with_gaps_does_not_jitter():
    t = np.arange(5000) * 0.002
    t[2000:] += 30.0
    t[4000:] += 0.5
    assert jitter(t) == 0
    assert jitter(t + 1e-5 * np.random.default_rng(0).normal(size=5000)) == 0
    assert jitter(np.array([0.0, 1.0, 1.5])) == 0


@pytest.mark.parametrize(
    ("begin", "end", "words"),
    [(10, 20, "10.0 to 20.0 s"), (-1, 5, "0.0 to 5.0 s"), (3, 9.5, "3.0 to 9.5 s")],
)
def test_a_stretch_without_readings_is_told_with_its_times(begin, end, words):
    (repair,) = told((begin > T) | (end < T))
    assert repair.lost
    assert words in repair.what


def test_of_many_stretches_the_first_are_told_one_by_one():
    (repair,) = told(T % 4 < 2)
    assert repair.what.endswith("2.0 to 4.0 s, 6.0 to 8.0 s, 10.0 to 12.0 s, 2 times more")


def test_rows_without_a_reading_are_lost_where_no_slower_sensor_explains_them():
    (slower,) = told(np.arange(2000) % 2 == 0)
    assert slower.what == "the wrench is measured in 1000 of 2000 rows: taken as a stream of 50 Hz"
    assert not slower.lost
    (lost,) = told(np.random.default_rng(0).random(2000) < 0.5)
    assert "the others are missing" in lost.what
    assert lost.lost


def slow_encoders(noise):
    """Joints at constant speeds, whose encoder counts change only every few samples."""
    speeds = np.array([0.0, 0.31, 0.17, 0.0, 0.093, 0.41])
    return np.round(np.arange(20_000)[:, None] * speeds + noise * np.random.default_rng(0).normal(size=(20_000, 6)))


def one_axis_that_repeats():
    readings = arm(4000)
    readings[:, 2] = np.repeat(readings[::4, 2], 4)
    return readings


NOT_HELD = {
    "encoders that move slowly": slow_encoders(1e-9),
    "encoders that jitter": slow_encoders(1.0),
    "one axis that repeats": one_axis_that_repeats(),
    "a constant": np.zeros((5000, 6)),
    "nothing measured": np.full((5000, 6), np.nan),
    "too short": arm(LEAST_SAMPLES - 1),
    "no samples": np.zeros((0, 6)),
}


@pytest.mark.parametrize("what", NOT_HELD)
def test_what_is_not_taken_for_held(what):
    assert find_held(NOT_HELD[what]) is None


def test_parts_and_rows_without_a_sample_change_nothing():
    values = np.repeat(arm(2000), 3, 0)
    sparse = np.full((12_000, 6), np.nan)
    sparse[::2] = values
    seen = Repeats()
    for part in np.split(sparse, [1, 777, 5000, 5001]):
        seen = extend_repeats(seen, part)
    np.testing.assert_array_equal(held_readings(seen).repeats, find_held(values).repeats)


def told(kept, t=T):
    return missing_readings("the wrench is", t[kept], T)


PAUSE = (T < 5) | (T > 15)


@pytest.mark.parametrize(
    ("t", "of_both"),
    [(T, T), (T[np.arange(2000) % 50 != 7], T), ((T + 1e-3)[::4], T), (T[:0], T), (T[PAUSE], T[PAUSE])],
    ids=["every row", "a row missing now and then", "a slower clock of its own", "never measured", "both pause"],
)
def test_a_stream_without_gaps_is_not_told(t, of_both):
    assert missing_readings("the wrench is", t, of_both) == ()
