"""Files of arrays whose streams have their own stamps, under common names."""

import h5py
import numpy as np
import pytest
from stated import PANDA

from ftbias_jax.errors import LogError
from ftbias_jax.io import read_log
from ftbias_jax.io.draft.rows import time_unit
from ftbias_jax.io.draft.table import look
from ftbias_jax.io.tables.clocks import clocks_of
from ftbias_jax.setup import parse_setup

SETUP = parse_setup(PANDA)
JOINTS, READINGS = 40, 100
NATIVE = ("t_joints", "q", "t_wrench", "wrench")
ARM = {"a/t": "t", "a/q": "q"}


@pytest.fixture(scope="module")
def streams():
    """Stamps and values of joints and wrench, at 100 and 250 Hz."""
    rng = np.random.default_rng(0)
    return (
        np.arange(JOINTS) * 0.01,
        rng.normal(size=(JOINTS, 7)),
        np.arange(READINGS) * 0.004,
        rng.normal(size=(READINGS, 6)),
    )


def written(path, arrays):
    if path.suffix == ".npz":
        np.savez(path, **arrays)
    else:
        with h5py.File(path, "w") as root:
            for name, values in arrays.items():
                root[name] = values
    return path


@pytest.mark.parametrize(
    ("suffix", "names"),
    [
        (".h5", ("joints/t", "joints/q", "ft/t", "ft/wrench")),
        (".h5", ("joint_states/timestamp", "joint_states/position", "wrench/timestamp", "wrench/ft")),
        (".h5", ("q/time", "q/data", "ft/time", "ft/values")),
        (".h5", ("timestamps/joint_positions", "state/joint_positions", "timestamps/ft_sensor", "state/ft_sensor")),
        (".npz", ("joint_time", "joint_pos", "ft_time", "ft")),
        (".npz", ("time_robot", "q", "time_sensor", "wrench")),
        (".npz", ("t_joints", "joint_positions", "t_wrench", "force_torque")),
    ],
)
def test_streams_have_the_stamps_that_their_names_show(tmp_path, streams, suffix, names):
    expected = read_log(written(tmp_path / "native.npz", dict(zip(NATIVE, streams, strict=True))), SETUP)
    log = read_log(written(tmp_path / f"log{suffix}", dict(zip(names, streams, strict=True))), SETUP)
    for ours, theirs in zip(log[:4], expected[:4], strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize(
    "names", [("t", "q", "wrench"), ("time", "joint_pos", "ft"), ("joint_time", "joint_pos", "ft_time", "ft")]
)
def test_stamps_may_be_a_column_of_a_matrix(tmp_path, streams, names):
    t, q, _, wrench = streams
    values = (t, q, wrench[:JOINTS]) if len(names) == 3 else (t, q, t, wrench[:JOINTS])
    flat = {name: x if x.ndim == 2 else x[:, None] for name, x in zip(names, values, strict=True)}
    log = read_log(written(tmp_path / "log.npz", flat), SETUP)
    np.testing.assert_array_equal(log.t, t)
    np.testing.assert_array_equal(log.q, q)


def test_streams_with_one_clock_are_a_table(tmp_path, streams):
    t, q, _, wrench = streams
    stamped = {"a/t": t, "a/q": q, "b/t": t, "b/wrench": wrench[:JOINTS]}
    log = read_log(written(tmp_path / "log.h5", stamped), SETUP)
    assert len(log.t) == JOINTS
    np.testing.assert_array_equal(log.wrench, wrench[:JOINTS])


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"one_time": "t", "other_time": "t", "q": "q", "wrench": "q6"}, "t_joints: there is no time"),
        ({"q_time": "t", "q": "q", "wrench": "wrench"}, "wrench: cannot determine which stamps belong to it"),
        (
            dict(ARM, **{"stamps/force": "t", "ft/force": "q3", "stamps/torque": "late", "ft/torque": "q3"}),
            "ft/torque: has other stamps, stamps/torque, than the other arrays of its stream",
        ),
    ],
)
def test_stamps_that_do_not_show_or_contradict_each_other_are_told(tmp_path, streams, arrays, words):
    t, q, _, wrench = streams
    values = {"t": t, "late": t + 1e-3, "q": q, "q6": q[:, :6], "q3": q[:, :3], "wrench": wrench}
    path = written(tmp_path / "log.h5", {name: values[kind] for name, kind in arrays.items()})
    with pytest.raises(LogError) as caught:
        read_log(path, SETUP)
    assert words in str(caught.value)


def test_of_stamps_in_one_folder_those_that_share_most_words_count():
    shapes = {"a/t_q": (5,), "a/t_ft": (5,), "a/q": (5, 7), "a/ft": (5, 6), "a/temperature": (5,), "b/x": (9,)}
    assert clocks_of(shapes) == {"a/q": "a/t_q", "a/ft": "a/t_ft"}


def test_their_unit_is_that_of_the_joints_stamps(tmp_path, streams):
    t, q, t_wrench, wrench = streams
    arrays = {"arm/time_ms": 1e3 * t, "arm/q": q, "ft/time_ms": 1e3 * t_wrench, "ft/wrench": wrench}
    table = look(str(written(tmp_path / "log.h5", arrays)))
    np.testing.assert_array_equal(table.time, 1e3 * t)
    assert time_unit(table.time) == "ms"
