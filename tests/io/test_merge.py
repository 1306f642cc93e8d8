"""Streams with their own stamps, merged on one timeline."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from one_line import fails

from ftbias_jax.io.check import check_overlap, merge_parts, on_one_clock
from ftbias_jax.io.stamps.clock import as_stamps
from ftbias_jax.setup.recorded import LogSetup


def merge(joint_t, q, wrench_t, wrench, **more):
    """Joints and a wrench with their own stamps."""
    streams = [(as_stamps(joint_t), {"q": q}), (as_stamps(wrench_t), {"wrench": wrench, **more})]
    parts = on_one_clock(streams, LogSetup(), "log.npz")
    check_overlap(parts[0][0], parts[1][0], "log.npz")
    return SimpleNamespace(**merge_parts(parts, "log.npz"))


def test_stamps_one_bit_apart_are_two_rows():
    log = merge([0.0, 1.0], np.zeros((2, 1)), [0.0, np.nextafter(1, 2)], np.zeros((2, 6)))
    assert len(log.t) == 3


def test_nanoseconds_stay_integers_whatever_their_types():
    start = 1_700_000_000_000_000_001
    log = merge(
        np.array([start, start + 2], np.int64), np.zeros((2, 1)), np.array([start + 1], np.uint64), np.zeros((1, 6))
    )
    assert log.t.tolist() == [start, start + 1, start + 2]


stamps = st.lists(st.integers(0, 30), min_size=1, max_size=12, unique=True).map(sorted)


@given(stamps, stamps)
def test_every_sample_is_there_once_in_order(joint_t, wrench_t):
    """The reference is a plain loop over the union of stamps."""
    joint_t, wrench_t = [-1, *joint_t, 31], [-2, *wrench_t, 32]  # so that they overlap
    log = merge(joint_t, [[t] for t in joint_t], wrench_t, np.repeat([[t] for t in wrench_t], 6, 1))
    assert log.t.tolist() == sorted({*joint_t, *wrench_t})
    for t, q, wrench in zip(log.t, log.q, log.wrench, strict=True):
        assert q[0] == t if t in joint_t else np.isnan(q[0])
        assert (wrench == t).all() if t in wrench_t else np.isnan(wrench).all()


@pytest.mark.parametrize(
    ("changes", "field", "what", "remedy"),
    [
        ({"wrench_t": [0, 1]}, "t_joints, t_wrench", "types float64 and int64 differ", "both in integer ns"),
        ({"wrench_t": [5.0, 6.0]}, "t_joints, t_wrench", "do not overlap in time: joints 0.0 to 1.0", "one clock"),
        ({"wrench_t": [-6.0, -5.0]}, "t_joints, t_wrench", "wrench -6.0 to -5.0", "one clock"),
        ({"joint_t": np.zeros(0), "q": np.zeros((0, 1))}, "t_joints, t_wrench", "joints none", "one clock"),
        ({"q": [[1.0]]}, "q", "has shape (1, 1) and type float64 for 2 stamps", "one sample of real numbers per stamp"),
        ({"wrench": 3.0}, "wrench", "has shape () and type float64 for 2 stamps", "per stamp"),
        ({"temperature": ["a", "b"]}, "temperature", "type <U1 for 2 stamps", "real numbers"),
    ],
)
def test_streams_that_do_not_fit_are_refused(changes, field, what, remedy):
    streams = {"joint_t": [0.0, 1.0], "q": [[1.0], [2.0]], "wrench_t": [0.5, 1.5], "wrench": np.ones((2, 6))}
    fails(lambda: merge(**{**streams, **changes}), f"log.npz: {field}", what, remedy)
