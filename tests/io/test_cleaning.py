import numpy as np
import pytest

from ftbias_jax.errors import LogError
from ftbias_jax.io.cleaning import ASIDE, clean, slices, survey
from ftbias_jax.io.log import Log, Repair

T = 900


def recorded(**changes):
    """A log at 100 Hz of a working sensor, with some arrays replaced."""
    rng = np.random.default_rng(0)
    t, nothing = np.arange(T) * 0.01, np.full(T, np.nan)
    log = Log(t, rng.normal(size=(T, 2)), np.full((T, 2), np.nan), rng.normal(size=(T, 6)), nothing)
    return log._replace(**changes)


def spoilt():
    """fz stands still for 3 s, and ty is clipped at 1."""
    log = recorded()
    log.wrench[300:600, 2] = 0.5
    log.wrench[:, 4] = np.minimum(5 * np.sin(log.t), 1)
    return log, log.wrench[:, 4] == 1


def test_a_sensor_in_order_is_left_alone():
    log = recorded(repairs=(Repair("before"),))
    assert clean(log).wrench is log.wrench
    assert clean(log).repairs == (Repair("before"),)


def test_a_raw_log_may_be_cleaned_later_and_says_everything_once():
    log, top = spoilt()
    raw = clean(log._replace(repairs=(Repair("before", lost=True),)), clipped=False, stuck=False)
    np.testing.assert_array_equal(raw.wrench, log.wrench)
    assert raw.repairs[2] == Repair("fz stands still from 3.0 s to 6.0 s: 300 samples")
    half = clean(raw, clipped=False)
    assert half.repairs == (
        Repair("before", lost=True),
        Repair(f"samples at the end of the sensor's range: {top.sum()} of ty"),
        Repair("fz stands still from 3.0 s to 6.0 s: 300 samples left out", lost=True),
    )
    np.testing.assert_array_equal(half.wrench[:, 4], log.wrench[:, 4])
    assert np.isnan(half.wrench[300:600, 2]).all()
    np.testing.assert_array_equal(clean(raw).wrench, clean(log).wrench)
    assert clean(clean(log)).repairs == clean(log).repairs


def test_many_stretches_are_told_in_short():
    t = np.arange(0, 40, 0.01)
    wrench = np.random.default_rng(1).normal(size=(len(t), 6))
    for start in range(0, 4000, 800):
        wrench[start : start + 300, 0] = start
    log = recorded(t=t, q=np.zeros((len(t), 2)), dq=np.zeros((len(t), 2)), wrench=wrench)
    (repair,) = clean(log).repairs
    spans = "from 0.0 s to 3.0 s and from 8.0 s to 11.0 s and from 16.0 s to 19.0 s and 2 more times"
    assert repair.what == f"fx stands still {spans}: 1500 samples left out"


def test_a_wrench_of_which_nothing_is_left_is_refused():
    dead = recorded(wrench=np.ones((T, 6)))
    with pytest.raises(LogError, match=r"log.npz: wrench: no wrench data: every axis stands still.*\(check the sensor"):
        clean(dead, file="log.npz")
    assert len(clean(dead, clipped=False, stuck=False).repairs) == 6


def in_motion():
    """A log of swinging joints with their speeds, five readings of which are wrong, and the rows of those."""
    t = np.arange(2000) * 0.004
    swing = np.stack([0.5 * np.sin(2 * t), np.sin(t + 1)], 1)
    q, dq = 1.5 + swing, np.stack([np.cos(2 * t), np.cos(t + 1)], 1)
    jumps, stale = np.array([0, 700, 701]), np.array([1200, 1201])
    q[jumps] = [[0], [0], [0.1]]
    q[stale] = q[1199]
    dq[900] = 40
    log = recorded(t=t, q=q, dq=dq, temperature=np.full(len(t), np.nan))
    return log._replace(wrench=np.random.default_rng(0).normal(size=(len(t), 6))), jumps, stale


def test_joints_where_no_arm_can_have_been_are_left_out_with_their_speeds():
    log, jumps, stale = in_motion()
    cleaned = clean(log)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(cleaned.q).any(1)), np.sort(np.r_[jumps, stale]))
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(cleaned.dq).any(1)), np.sort(np.r_[jumps, 900, stale]))
    assert not np.isnan(cleaned.wrench).any()
    told = {repair.what: repair.lost for repair in cleaned.repairs}
    assert told == {
        "the joints are stale now and then while they move: 2 left out": False,
        "the joints are implausible, at 0.0, 2.8, 2.8 s: 3 readings left out": True,
        "the velocities are implausible, at 3.6 s: 1 readings left out": True,
    }


def test_readings_that_are_left_out_for_a_diagnosis_are_kept_in_the_raw_log():
    log, *_ = in_motion()
    raw = clean(log, held=())
    np.testing.assert_array_equal(raw.q, log.q)
    assert [repair.lost for repair in raw.repairs] == [False] * 3
    cleaned, of_raw = clean(log, held=("q", "dq")), clean(raw, held=("q", "dq"))
    np.testing.assert_array_equal(of_raw.q, cleaned.q)
    assert of_raw.repairs == cleaned.repairs
    assert clean(cleaned).repairs == cleaned.repairs
    halves = [log._replace(**rows(log, part)) for part in (slice(1000), slice(1000, 2000))]
    for of_parts, times in zip(survey(slices(*halves)).glitches, survey(slices(log)).glitches, strict=True):
        np.testing.assert_array_equal(of_parts, times)


def test_a_log_that_goes_on_elsewhere_is_left_out_there():
    """No smooth motion connects both sides, and the wrench in between would be mistaken for contact."""
    log = recorded(t=np.arange(T) * 0.01, q=np.sin(np.arange(T)[:, None] * 0.01 + [0.0, 1.0]))
    log.q[500:] += 0.4
    cleaned = clean(log)
    out = np.abs(log.t - 5) < ASIDE - 0.005
    for name in ("q", "wrench"):
        missing = np.isnan(getattr(cleaned, name)).all(1)
        assert missing[out].all()
        assert missing.sum() <= out.sum() + 2
    (repair,) = cleaned.repairs
    assert repair.lost
    assert repair.what.startswith("the joint positions are discontinuous at 5.0 s: samples are missing there")
    assert clean(cleaned).repairs == cleaned.repairs


def rows(log, part):
    return {name: getattr(log, name)[part] for name in ("t", "q", "dq", "wrench", "temperature")}
