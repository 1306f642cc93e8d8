import re

import log_files
import numpy as np
import pytest
import recordings
from recordings import Joints, Wrench

from ftbias_jax.cli.main import main
from ftbias_jax.io.info import describe
from ftbias_jax.io.ros.messages import WRENCH
from ftbias_jax.io.ros.read import skew
from ftbias_jax.io.ros.record import Stream
from ftbias_jax.setup import dump_setup


@pytest.mark.parametrize("suffix", log_files.SUFFIXES)
def test_native_formats_need_no_setup(tmp_path, setup, suffix):
    log = recordings.arrays()
    if suffix in (".csv", ".parquet"):
        t = (log["t_joints"] - log["t_joints"][0]) * 1e-9
        log = {"t": t, "q": log["q"], "wrench": log["wrench"][::2]}
    path = log_files.write(tmp_path / f"log{suffix}", log)
    info = describe(path)
    joints, wrench = info.streams
    assert joints.names == ("q0", "q1")
    assert joints.rate == pytest.approx(50)
    assert wrench.samples in (30, 60)
    assert info.verdict == "has 2 joints and a wrench"
    assert describe(path, setup).verdict == "can be filtered"


def test_trouble_is_named(tmp_path):
    published, t = [], recordings.START
    rng = np.random.default_rng(0)
    for i in range(900):
        t += 10_000_000 if i != 600 else 5_000_000_000
        force = (1.0, min(np.sin(i / 99), 0.9), *rng.normal(size=3), np.nan)
        published += [Wrench(t, force), Joints(t, ("base", "elbow"), (0.0, 0.0))]
    wrench, joints = describe(recordings.write(tmp_path, "ros1", published)).streams
    trouble = "; ".join(wrench.trouble)
    assert "fx: stuck for " in trouble
    assert "fy: saturated at 0.9" in trouble
    assert "tz: 100 % not measured" in trouble
    assert "/wrench was recorded 1e-06 s after its stamps" in trouble
    ((at, length),) = wrench.gaps
    assert at == pytest.approx(5.99)
    assert length == pytest.approx(5.0)
    assert "velocity of base: 100 % not measured" in joints.trouble
    assert not any("stuck" in line for line in joints.trouble)  # joints may rest


def test_a_clock_that_runs_fast_is_told_from_stamps_alone(tmp_path):
    """From a topic's stamps and the recorder's times, or from streams of array files that end apart."""
    true = np.arange(4000) * 0.01
    logged = np.rint((true + np.random.default_rng(0).exponential(1e-3, len(true))) * 1e9).astype(np.int64)
    stamps = np.rint(1.0005 * true * 1e9).astype(np.int64)
    stream = Stream("/ft", "", WRENCH, (), stamps, logged, logged, np.zeros((4000, 6)))
    assert re.search(r"whose clock runs (499|500|501)", skew(stream))
    assert "clock" not in skew(stream._replace(stamps=np.rint(true * 1e9).astype(np.int64)))
    log = recordings.arrays(samples=600)
    t = log["t_wrench"]
    for rate, words in ((1.8e-2, "wrench_rate = 1"), (0.0, "")):
        stamps = t + np.rint((t - t[0]) * rate).astype(np.int64)
        _, wrench = describe(log_files.write(tmp_path / f"{rate}.npz", log | {"t_wrench": stamps})).streams
        assert words in "".join(wrench.trouble)
        assert ("wrench_rate" in "".join(wrench.trouble)) == bool(words)


def test_what_cannot_be_filtered_says_why(tmp_path, setup, make_setup):
    only_wrench = [m for m in recordings.messages() if isinstance(m, Wrench)]
    info = describe(recordings.write(tmp_path, "ros1", only_wrench), setup)
    assert info.verdict == "nothing can be filtered without joints (sensor_msgs/JointState)"
    joints = [{"axis": [0, 0, 1], "point": [0, 0, 0], "name": "other"}]
    other = make_setup(robot={"joints": joints, "flange": {"translation": [0, 0, 1]}})
    (tmp_path / "b").mkdir()
    path = recordings.write(tmp_path / "b", "ros1", recordings.messages())
    assert (
        "none of the setup's joints other is recorded (/joint_states has base, elbow)" in describe(path, other).verdict
    )
    assert describe(path).verdict == "has joints and a wrench: --setup tells whether they fit"


def test_the_command(tmp_path, setup, capsys):
    published = [m._replace(frame="\x1b[31mred") if isinstance(m, Wrench) else m for m in recordings.messages()]
    path = recordings.write(tmp_path, "ros1", published)
    (tmp_path / "setup.toml").write_text(dump_setup(setup))
    assert main(["info", str(path), "--setup", str(tmp_path / "setup.toml")]) == 0
    printed = capsys.readouterr().out
    assert "\x1b" not in printed
    assert "of: ?[31mred" in printed
    assert "60 samples, 100 Hz, 0.59 s from 2023-11-14T22:13:20.123Z" in printed
    assert f"{path}: can be filtered\n" in printed
    assert printed.splitlines()[-1].startswith("next: ftbias ")
    path.write_bytes(path.read_bytes()[:-2000])
    assert main(["info", str(path)]) == 3
    assert "repaired: is cut short" in capsys.readouterr().out
    assert main(["info", str(tmp_path / "none.bag")]) == 1
    assert "cannot be read: No such file" in capsys.readouterr().err
