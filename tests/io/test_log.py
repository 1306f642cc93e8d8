"""Logs from arrays in memory equal those read from a file with the same arrays."""

from pathlib import Path

import numpy as np
import pytest
from stated import pose_setup

from ftbias_jax.check.check_setup import check_setup
from ftbias_jax.io import each_of, names_of, read_log
from ftbias_jax.io.log import Log
from ftbias_jax.io.tables.poses import Poses

T = 600


def arrays():
    rng = np.random.default_rng(0)
    wrench = rng.normal(size=(T, 6))
    wrench[100:400, 3] = 0.5
    t = 100 + 0.01 * np.arange(T)
    t[50] = t[49]
    return {"t": t, "q": rng.normal(size=(T, 2)), "wrench": wrench, "dq": rng.normal(size=(T, 2)), "temperature": t}


def assert_same(log, other):
    for one, two in zip(log[:6], other[:6], strict=True):
        np.testing.assert_array_equal(one, two)
    assert log.repairs == other.repairs


@pytest.mark.parametrize("raw", [False, True])
def test_arrays_are_checked_and_cleaned_as_files_are(tmp_path, make_setup, raw):
    setup = make_setup(sensor={"noise_std": 0.1, "reports": "wrench_on_sensor"})
    given = arrays()
    np.savez(tmp_path / "log.npz", **given)
    log = Log.from_arrays(setup, *given.values(), raw=raw)
    assert_same(log, read_log(tmp_path / "log.npz", setup, raw=raw))
    assert [repair.lost for repair in log.repairs] == [True, not raw]
    assert np.isnan(log.wrench[:, 3]).any() == (not raw)


def test_a_pose_stands_in_for_the_joints(tmp_path):
    setup = pose_setup(orientation="quaternion_xyzw", linear="none")
    given, half = arrays(), 0.3 * np.sin(np.arange(T) / 50)
    turns = np.stack([np.sin(half), 0 * half, 0 * half, np.cos(half)], 1)
    np.savez(tmp_path / "log.npz", t=given["t"], orientation=turns, wrench=given["wrench"])
    log = Log.from_arrays(setup, given["t"], None, given["wrench"], orientation=turns)
    assert_same(log, read_log(tmp_path / "log.npz", setup))


def test_a_log_or_path_alone_is_a_list_of_one(setup):
    log = Log.from_arrays(setup, *arrays().values())
    poses = Poses(np.zeros(1), False, np.zeros((1, 7)), np.zeros((1, 6)))
    for alone in (log, poses, "log.npz", Path("log.npz")):
        assert each_of(alone) == [alone]
        assert each_of([alone]) == [alone]
        assert each_of((alone, alone)) == (alone, alone)
    assert str(check_setup(setup, log)) == str(check_setup(setup, [log]))


def test_logs_are_named_by_their_files_without_what_is_secret(setup):
    log = Log.from_arrays(setup, *arrays().values())
    files = "runs/monday.npz", "", "https://me:key@host/tuesday.csv?token=secret"
    assert names_of([log._replace(file=file) for file in files]) == ["monday.npz", "log 2", "tuesday.csv"]
