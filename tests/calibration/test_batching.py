"""Logs in batches of equal shape: nothing is lost, and padding counts as not measured."""

import numpy as np
import pytest

from ftbias_jax.calibration.tune import cut, equal_parts, stack
from ftbias_jax.types import Sample


def log_of(length, seed=0):
    rng = np.random.default_rng(seed)
    dt = np.r_[0.0, rng.uniform(0.001, 0.003, length - 1)]
    return Sample(dt, *(rng.normal(size=(length, width)) for width in (3, 3, 6)))


@pytest.mark.parametrize("length", [0, 7, 9])
def test_a_bundle_holds_every_log_and_is_padded_by_nothing(length):
    logs = [log_of(5), log_of(7, seed=1)]
    bundle = stack(logs, length)
    for i, log in enumerate(logs):
        for whole, leaf, filler in zip(bundle[:4], log[:4], (0, np.nan, np.nan, np.nan), strict=True):
            assert whole.shape[:2] == (2, max(length, 7))
            np.testing.assert_array_equal(whole[i, : len(leaf)], leaf)
            np.testing.assert_array_equal(whole[i, len(leaf) :], filler)


@pytest.mark.parametrize("length", [1, 4, 10, 11])
def test_pieces_are_the_log_and_start_anew(length):
    log = log_of(10)
    pieces = cut(log, length)
    sizes = [len(piece.dt) for piece in pieces]
    assert len(sizes) == -(-len(log.dt) // length)  # no longer than needed
    assert max(sizes) <= length
    assert max(sizes) - min(sizes) <= 1
    assert {piece.dt[0] for piece in pieces} == {0}
    for whole, leaves in zip(log[1:4], zip(*(piece[1:4] for piece in pieces), strict=True), strict=True):
        np.testing.assert_array_equal(np.concatenate(leaves), whole)


@pytest.mark.parametrize(
    ("count", "at_once", "expected"), [(3, 2, [2, 2]), (4, 4, [4]), (5, 2, [2, 2, 2]), (1, 3, [1])]
)
def test_parts_are_equally_many_logs(count, at_once, expected):
    logs = [log_of(4, seed) for seed in range(count)]
    parts = equal_parts(logs, at_once)
    assert [len(part) for part in parts] == expected
    found = [log for part in parts for log in part]
    assert all(sum(log is other for other in found) == 1 for log in logs)
    fillers = [log for log in found if not any(log is other for other in logs)]
    assert all(np.isnan(leaf).all() for log in fillers for leaf in log[1:4])


def test_logs_of_a_part_are_about_as_long_and_the_first_parts_are_of_all_lengths():
    lengths = np.random.default_rng(0).permutation(np.arange(1, 65))
    parts = equal_parts([log_of(length) for length in lengths], 4)
    spread = [max(len(log.dt) for log in part) - min(len(log.dt) for log in part) for part in parts]
    assert max(spread) == 3
    first = [np.mean([len(log.dt) for log in part]) for part in parts[:4]]
    assert min(first) < 20
    assert max(first) > 45
