"""Recorded poses: signs, lengths, missing rows, rates of an IMU, and the same pose in every format."""

import log_files
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stated import pose_setup

from ftbias_jax.errors import LogError, SetupError
from ftbias_jax.io import read_log
from ftbias_jax.io.pose import continuous, product, quaternions_of, rotate

COUNT = 50


def turning(count=COUNT, rate=3.0):
    """Quaternions w, x, y, z of a steady turn about a slanted axis, by more than a whole turn, 0.1 s apart."""
    angle = 0.1 * rate * np.arange(count)[:, None]
    return np.hstack([np.cos(angle / 2), np.sin(angle / 2) * [0.6, 0.0, 0.8]])


@given(signs=st.lists(st.booleans(), min_size=COUNT, max_size=COUNT), missing=st.sets(st.integers(0, COUNT - 1)))
def test_signs_and_gaps_leave_one_smooth_path(signs, missing):
    expected = turning(rate=0.5)
    quaternion = np.where(np.array(signs)[:, None], -expected, expected)
    quaternion[sorted(missing)] = np.nan
    got = continuous(quaternion)
    known = np.isfinite(got).all(1)
    assert known.sum() == COUNT - len(missing)
    if known.any():
        sign = np.sign((got[known][0] * expected[known][0]).sum())
        np.testing.assert_allclose(sign * got[known], expected[known])


@given(seed=st.integers(0, 2**32 - 1))
def test_products_and_turns_are_those_of_matrices(seed):
    matrices, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(8, 3, 3)))
    matrices *= np.linalg.det(matrices)[:, None, None]
    matrices[0] = np.diag([1, -1, -1])  # half a turn
    one, other = quaternions_of(matrices[:4]), quaternions_of(matrices[4:])
    vectors = np.random.default_rng(seed).normal(size=(4, 3))
    np.testing.assert_allclose(rotate(one, vectors), np.einsum("tij,tj->ti", matrices[:4], vectors), atol=1e-12)
    both = np.einsum("tij,tjk->tik", matrices[:4], matrices[4:])
    np.testing.assert_allclose(np.abs((product(one, other) * quaternions_of(both)).sum(1)), 1, atol=1e-12)


@pytest.mark.parametrize(
    ("orientation", "place", "value", "words"),
    [
        ("quaternion_wxyz", 7, [2, 0, 0, 0], "sample 7 is no quaternion of length one"),
        ("quaternion_wxyz", (7, 0), np.inf, "sample 7 is no quaternion of length one"),
        ("matrix", slice(None), np.diag([1.0, 1, -1]), "sample 0 is no rotation matrix"),
    ],
)
def test_rows_that_are_no_rotation_are_named(tmp_path, orientation, place, value, words):
    recorded = np.zeros((COUNT, 3, 3)) if orientation == "matrix" else turning()
    recorded[place] = value
    np.savez(tmp_path / "log.npz", t=0.1 * np.arange(COUNT), orientation=recorded, wrench=np.ones((COUNT, 6)))
    with pytest.raises(LogError, match=f"orientation: {words}"):
        read_log(tmp_path / "log.npz", pose_setup(linear="none", orientation=orientation))


def test_arrays_that_are_missing_are_named(tmp_path):
    stamps = {"t": 0.1 * np.arange(COUNT), "wrench": np.ones((COUNT, 6))}
    np.savez(tmp_path / "log.npz", **stamps, orientation=turning())
    for linear, words in (("position", "position: there is no array position"), ("specific_force", "specific force")):
        with pytest.raises(LogError, match=words):
            read_log(tmp_path / "log.npz", pose_setup(linear=linear, orientation="quaternion_wxyz"))
    np.savez(tmp_path / "log.npz", **stamps, orientation=turning(), position=np.ones((3, 3)))
    with pytest.raises(LogError, match="orientation, position: have 50 and 3 samples"):
        read_log(tmp_path / "log.npz", pose_setup(orientation="quaternion_wxyz"))


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".h5"])
def test_every_format_has_poses(tmp_path, suffix):
    rng = np.random.default_rng(0)
    widths = {"position": 3, "angular_velocity": 3, "wrench": 6}
    arrays = {"t": 0.1 * np.arange(COUNT), "orientation": turning()[:, [1, 2, 3, 0]]}
    arrays |= {name: rng.normal(size=(COUNT, width)) for name, width in widths.items()}
    logs = (read_log(log_files.write(tmp_path / f"log{s}", arrays), pose_setup())[:5] for s in (suffix, ".npz"))
    for got, expected in zip(*logs, strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-12)


def test_pose_and_wrench_may_have_their_own_stamps(tmp_path):
    t = 10**9 + 10**7 * np.arange(COUNT)
    np.savez(tmp_path / "log.npz", t_joints=t, t_wrench=t[::2] + 10**6, orientation=turning(), wrench=np.ones((25, 6)))
    log = read_log(tmp_path / "log.npz", pose_setup(linear="none", orientation="quaternion_wxyz"))
    assert np.isfinite(log.q).all(1).sum() == COUNT
    assert np.isfinite(log.wrench).all(1).sum() == 25


@pytest.mark.parametrize(
    ("section", "words"),
    [
        ({"orientation": "euler"}, "unknown value 'euler'"),
        ({"linear": "speed"}, "unknown value 'speed'"),
        ({"acceleration_std": 0.1}, "excluded by linear = 'position'"),
        ({"base": "world"}, "name the frame of TF"),
        ({"frame": "tool0", "orientation": "matrix"}, "TF has quaternions"),
    ],
)
def test_setups_that_make_no_sense_are_named(section, words):
    with pytest.raises(SetupError, match=words):
        pose_setup(**section)


def test_an_arm_beside_a_pose_is_refused():
    with pytest.raises(SetupError, match=r"robot\.model: unknown key"):
        pose_setup(tables={"robot": {"model": "panda"}})
