"""The same log through every format gives the same results after filtering."""

import h5py
import numpy as np
import pyarrow
import pyarrow.parquet
import pytest
import recordings
from recordings import FORMATS

from ftbias_jax.cli.commands.filter import filter_file
from ftbias_jax.io import read_log
from ftbias_jax.io.parts import open_log
from ftbias_jax.io.write.npz import load_npz
from ftbias_jax.io.write.selection import Selection
from ftbias_jax.setup import parse_setup

SETUP = {
    "robot": {
        "joints": [
            {"axis": [0, 0, 1], "point": [0, 0, 0], "name": "base"},
            {"axis": [0, 1, 0], "point": [0, 0, 0.5], "name": "elbow"},
        ],
        "flange": {"translation": [0, 0, 1]},
    },
    "sensor": {"noise_std": [0.1, 0.004]},
    "tool": {"mass": 0.7, "center_of_mass": [0, 0, 0.06]},
    "bias": {"adapt": False},  # its made-up wrench has nothing to do with the arm
    "joints": {"position_noise_std": 1e-4, "velocity_noise_std": 1e-3},
}
SAMPLES = 400
EXACTLY = Selection(precision="double")


@pytest.fixture(scope="module")
def streams():
    """Joints at 50 Hz and a wrench at 100 Hz with stamps of nanoseconds since 1970, a moving arm."""
    log = recordings.arrays(SAMPLES)
    rng = np.random.default_rng(2)
    t = (log["t_joints"] - recordings.START) * 1e-9
    phase = t[:, None] * [1.0, 1.4]
    log["q"] = np.sin(phase) + 1e-4 * rng.normal(size=phase.shape)
    log["dq"] = np.cos(phase) * [1.0, 1.4] + 1e-3 * rng.normal(size=phase.shape)
    return log


def columns(log):
    names = ["t", *(f"q{i}" for i in range(2)), *(f"dq{i}" for i in range(2)), "fx", "fy", "fz", "tx", "ty", "tz"]
    return dict(zip(names, np.column_stack([log.t, log.q, log.dq, log.wrench]).T, strict=True))


def write_csv(path, log):
    table = columns(log)
    np.savetxt(path, np.column_stack([*table.values()]), "%.17g", ",", header=",".join(table), comments="")


def write_hdf5(path, log):
    with h5py.File(path, "w") as root:
        for name in ("t", "q", "dq", "wrench"):
            root[name] = getattr(log, name)


FILES = {
    "log.csv": write_csv,
    "log.parquet": lambda path, log: pyarrow.parquet.write_table(pyarrow.table(columns(log)), path),
    "log.h5": write_hdf5,
    "log.npz": lambda path, log: np.savez(path, t=log.t, q=log.q, dq=log.dq, wrench=log.wrench),
}


def filtered(path, folder):
    setup = parse_setup(SETUP)
    assert filter_file(open_log(path, setup), setup, folder / "result.npz", EXACTLY).repairs == ()
    return load_npz(folder / "result.npz")


@pytest.fixture(scope="module")
def native(streams, tmp_path_factory):
    """The path of the native file with two clocks, and its result."""
    folder = tmp_path_factory.mktemp("native")
    np.savez(folder / "log.npz", **streams)
    return folder / "log.npz", filtered(folder / "log.npz", folder)


@pytest.mark.parametrize("kind", [*FILES, *FORMATS])
def test_every_format_gives_the_same_result(streams, native, tmp_path, kind):
    path, expected = native
    if kind in FILES:
        FILES[kind](tmp_path / kind, read_log(path, parse_setup(SETUP)))
        result = filtered(tmp_path / kind, tmp_path)
    else:
        result = filtered(recordings.write(tmp_path, kind, recordings.messages(streams)), tmp_path)
    assert result.keys() == expected.keys()
    assert len(result["t"]) == SAMPLES
    for name, values in expected.items():
        got = result[name]
        if name in ("provenance", "about"):  # name the file and its frame
            continue
        if name == "t":  # files in seconds start at zero
            got, values = got - got[0], values - values[0]
            np.testing.assert_allclose(got, values, rtol=0, atol=1e-6)  # an epoch in float64 has 0.2 us
        else:
            np.testing.assert_allclose(got, values, rtol=1e-12, atol=1e-12 * np.abs(values).max(), err_msg=name)
