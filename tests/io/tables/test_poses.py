"""Static poses from tables, with and without time, and tables that are no poses."""

import numpy as np
import pytest
from log_files import SUFFIXES, write

from ftbias_jax.errors import LogError
from ftbias_jax.io import read_log, read_motion
from ftbias_jax.io.log import Log
from ftbias_jax.io.tables.poses import MOST, Poses, read_poses

RNG = np.random.default_rng(0)
Q, WRENCH = RNG.normal(size=(6, 2)), RNG.normal(size=(6, 6))


def table(t=None, rows=6):
    """Arrays of a table of poses."""
    times = {} if t is None else {"t": t}
    return times | {"q": Q[np.arange(rows) % 6], "wrench": WRENCH[np.arange(rows) % 6]}


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("t", [None, 5.0 + 2.0 * np.arange(6)], ids=["no time", "time"])
def test_a_table_is_read_in_every_format(tmp_path, setup, suffix, t):
    path = write(tmp_path / f"poses{suffix}", table(t))
    for poses in (read_poses(path, setup), read_motion(path, setup)):
        assert isinstance(poses, Poses)
        np.testing.assert_allclose(poses.q, Q)
        np.testing.assert_allclose(poses.wrench, WRENCH)
        np.testing.assert_allclose(poses.t, np.arange(6) if t is None else t - 5)
        assert poses.timed == (t is not None)
        assert poses.repairs == ()


def test_the_sign_of_the_report_is_kept(make_setup):
    setup = make_setup(sensor={"noise_std": [0.1, 0.004], "reports": "wrench_on_sensor"})
    np.testing.assert_array_equal(Poses.from_arrays(setup, WRENCH, Q).wrench, -WRENCH)


@pytest.mark.parametrize("linear", ["position", "specific_force", "none"])
def test_of_a_recorded_pose_the_orientation_is_enough(make_setup, linear, tmp_path):
    setup = make_setup(robot={}, sensor_pose={"linear": linear, "orientation": "matrix"})
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    matrices = np.tile(turn, (6, 1, 1))
    poses = Poses.from_arrays(setup, WRENCH, orientation=matrices)
    np.testing.assert_allclose(np.abs(poses.q), np.tile(np.sqrt([0.5, 0, 0, 0.5]), (6, 1)), atol=1e-12)
    header = "fx,fy,fz,tx,ty,tz," + ",".join(f"r{i}{j}" for i in "123" for j in "123")
    lines = [",".join(f"{x:.17g}" for x in row) for row in np.column_stack([WRENCH, matrices.reshape(6, 9)])]
    (tmp_path / "poses.csv").write_text("\n".join([header, *lines]))
    np.testing.assert_allclose(read_motion(tmp_path / "poses.csv", setup).q, poses.q)


def test_poses_that_are_not_complete_are_left_out_and_counted(setup):
    wrench = WRENCH.copy()
    wrench[2, 4] = np.nan
    poses = Poses.from_arrays(setup, wrench, Q)
    np.testing.assert_array_equal(poses.t, [0, 1, 3, 4, 5])
    assert poses.repairs[0].lost
    assert poses.repairs[0].what == "1 of the 6 poses left out: not complete"


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"wrench": WRENCH[:3], "q": Q[:3]}, "has 3 poses"),
        ({"wrench": np.zeros((MOST + 1, 6)), "q": np.zeros((MOST + 1, 2))}, f"has {MOST + 1} poses"),
        ({"wrench": WRENCH, "q": Q, "t": 0.01 * np.arange(6)}, "rate of 100 Hz"),
        ({"wrench": WRENCH, "q": Q, "t": np.zeros(6)}, "time does not increase"),
        ({"wrench": WRENCH, "q": Q[:, :1]}, "has shape (6, 1)"),
        ({"wrench": WRENCH}, "there is no pose"),
    ],
)
def test_what_is_no_table_of_poses_is_refused(setup, arrays, words):
    with pytest.raises(LogError) as caught:
        Poses.from_arrays(setup, **arrays)
    assert words in str(caught.value)
    assert caught.value.remedy


def test_a_log_stays_a_log_and_its_faults_are_told_as_before(tmp_path, setup):
    path = tmp_path / "log.csv"
    write(path, table(0.01 * np.arange(6)))
    assert isinstance(read_motion(path, setup), Log)
    write(path, table(rows=MOST + 1))
    with pytest.raises(LogError) as of_log:
        read_log(path, setup)
    with pytest.raises(LogError) as caught:
        read_motion(path, setup)
    assert str(caught.value) == str(of_log.value)
    with pytest.raises(LogError, match="unknown format"):
        read_motion(tmp_path / "log.doc", setup)
    with pytest.raises(LogError, match="is no table of poses"):
        read_poses(tmp_path / "log.bag", setup)
