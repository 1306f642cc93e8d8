"""The command line: what it writes, which input it refuses with one line, and the exit codes."""

import contextlib
import io
import os
import re
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from ftbias_jax import __version__
from ftbias_jax.cli.commands.demo import TRUE_MASS
from ftbias_jax.cli.main import main
from ftbias_jax.errors import UsageError
from ftbias_jax.io.write import npz
from ftbias_jax.runtime.jax_config import prepare_jax
from ftbias_jax.setup import dump_setup

JOINTS, DURATION, RATE = 7, 2, 100
OUTPUT = {
    **dict.fromkeys(["bias", "drift", "bias_std", "drift_std", "wrench_unbiased", "wrench_tool", "innovation"], 6),
    **dict.fromkeys(["q", "dq", "ddq", "ddq_std"], JOINTS),
    **dict.fromkeys(["t", "nis"], None),
}
TEXTS = ("about", "provenance")
"""Arrays of text, which name files."""
SMOOTHED = ["bias_smooth", "drift_smooth", "bias_smooth_std", "drift_smooth_std"]


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """Folder and output of a demonstration whose diagnosis is given the answer, unlike in test_demo.py."""
    folder, printed = tmp_path_factory.mktemp("demo") / "new" / "folder", io.StringIO()
    with contextlib.redirect_stdout(printed), pytest.MonkeyPatch.context() as patch:
        patch.setattr("ftbias_jax.cli.commands.demo._diagnose", knowing_diagnosis)
        code = main(["demo", "-o", str(folder), "--duration", str(DURATION), "--rate", str(RATE)])
    assert code == 0
    return folder, printed.getvalue()


def knowing_diagnosis(setup, log, folder):
    (folder / "report.html").write_text("")
    (folder / "fixed.toml").write_text(dump_setup(replace(setup, effects={"tool_mass": {"mass": TRUE_MASS}})))
    return SimpleNamespace(sentence="the tool is heavy", causes=())


@pytest.fixture
def copy(demo, tmp_path):
    """The demonstration's log as arrays and its setup as text, both to be changed, and a function that filters them."""
    arrays, text = npz.load_npz(demo[0] / "log.npz"), (demo[0] / "setup.toml").read_text()

    def run(arrays, text, *more):
        np.savez(tmp_path / "log.npz", **arrays)
        (tmp_path / "setup.toml").write_text(text)
        return filter_log(tmp_path, tmp_path / "log.npz", tmp_path / "setup.toml", *more)

    return arrays, text, run


def filter_log(folder, log, setup, *more):
    return main(["filter", str(log), "--setup", str(setup), "-o", str(folder / "out.npz"), *map(str, more)])


def assert_one_line(capsys, *words):
    """Check that an error is one line on standard error, with nothing on standard output."""
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("ftbias: ")
    assert printed.err.count("\n") == 1
    assert printed.err.endswith("\n")
    for word in words:
        assert word in printed.err


def assert_decodes(path):
    from matplotlib.image import imread

    assert imread(path).std() > 0.01


def test_help_and_usage_errors_come_before_jax_and_numpy():
    program = """if True:
        import sys
        from ftbias_jax.cli.main import main
        for arguments in ("--help", "filter --help", "demo --help", "--version", "", "filter log.npz"):
            try:
                main(arguments.split())
            except SystemExit as end:
                print("code", end.code)
        print({"jax", "numpy"} & sys.modules.keys())"""
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    lines = run.stdout.splitlines()
    assert [line for line in lines if line.startswith("code")] == ["code 0"] * 4 + ["code 2"] * 2
    assert lines[-1] == "set()"
    assert "Exit codes: 0 ok, 1 failed, 2 usage, 3 finished with data loss." in run.stdout
    assert "the following arguments are required: --setup, -o/--output" in run.stderr


def test_the_package_runs_as_a_module():
    words = [sys.executable, "-m", "ftbias_jax", "--version"]
    assert subprocess.run(words, capture_output=True, text=True, check=True).stdout == f"ftbias {__version__}\n"


def test_demo_writes_logs_setups_results_and_figures(demo):
    folder, printed = demo
    names = "after.npz after.png before.npz before.png fixed.toml log.npz report.html setup.toml"
    assert sorted(os.listdir(folder)) == names.split()
    for name in ("before.png", "after.png"):
        assert_decodes(folder / name)
    for words in ("1 filter ", "2 diagnose  the tool is heavy", "3 filter ", "the truth ", "inside 2 sigma after"):
        assert words in printed


def test_filter_writes_what_the_formats_say(demo, tmp_path, capsys):
    """The demonstration's log, filtered again, with a figure and smoothing."""
    folder, plot = demo[0], tmp_path / "out.svg"
    more = ["--plot", plot, "--smooth", "--check"]
    assert filter_log(tmp_path, folder / "log.npz", folder / "setup.toml", *more) == 0
    result, log = npz.load_npz(tmp_path / "out.npz"), npz.load_npz(folder / "log.npz")
    for name, width in {**OUTPUT, **dict.fromkeys(SMOOTHED, 6)}.items():
        assert result[name].shape == (DURATION * RATE, width)[: 1 if width is None else 2], name
        assert np.isfinite(result[name]).all(), name
        assert result[name].dtype == (np.float64 if name == "t" else np.float32)
    assert result["log_likelihood"].shape == ()
    np.testing.assert_array_equal(result["t"], log["t"])
    np.testing.assert_allclose(result["wrench_unbiased"], log["wrench"] + result["bias"], rtol=0, atol=1e-5)
    assert (result["bias_smooth_std"] <= result["bias_std"] * (1 + 1e-9)).all()
    for name, values in npz.load_npz(folder / "before.npz").items():
        if name not in TEXTS:  # the command compiles a short log's program for few calls, which rounds differently
            np.testing.assert_allclose(result[name], values, rtol=1e-6, atol=1e-12)
    printed = capsys.readouterr()
    assert not re.search("error|warning", printed.err)  # on a slow machine only progress
    assert f"{DURATION * RATE} wrench samples" in printed.out
    assert "consistency of the innovations" in printed.out
    assert f"wrote {tmp_path / 'out.npz'} and {plot}" in printed.out
    assert plot.read_bytes().startswith(b"<?xml")


@pytest.mark.parametrize(("reports", "sign"), [("wrench_on_tool", 1), ("wrench_on_sensor", -1)])
def test_offsets_are_what_is_added_to_the_reading(copy, tmp_path, capsys, reports, sign):
    """For both signs, the last reading plus the offsets is the last corrected wrench, in the sensor's own sign."""
    arrays, text, run = copy
    text = text.replace("wrench_on_tool", reports)
    arrays["wrench"] *= sign
    assert run(arrays, text, "--offsets", tmp_path / "offsets.yaml") == 0
    written = (tmp_path / "offsets.yaml").read_text()
    assert re.match(r"# by ftbias_jax \S+ from log.npz with setup.toml, sha256 [0-9a-f]{64}\n", written)
    numbers = re.findall(r"[xyz]: ([-+.\de]+)", written)
    corrected = arrays["wrench"][-1] + np.array(numbers, float)
    unbiased = npz.load_npz(tmp_path / "out.npz")["wrench_unbiased"][-1]
    np.testing.assert_allclose(sign * corrected, unbiased, rtol=0, atol=1e-5)
    assert "offsets that the broadcaster adds to each reading" in capsys.readouterr().out


def without(name):
    return lambda arrays, text: ({key: x for key, x in arrays.items() if key != name}, text)


def with_line(key, line):
    """The setup with the line of a key replaced."""

    def spoil(arrays, text):
        lines = [line if old.startswith(f"{key} = ") else old for old in text.splitlines()]
        assert lines != text.splitlines()
        return arrays, "\n".join(lines)

    return spoil


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (with_line("mass", "masss = 0.9"), ["setup.toml: tool.masss", "did you mean 'mass'?"]),
        (with_line("mass", ""), ["setup.toml: tool.mass", "is not stated", "ftbias identify LOG"]),
        (with_line("noise_std", "noise_std = ["), ["setup.toml", "is not valid TOML", "correct the syntax"]),
        (without("q"), ["log.npz: q"]),
    ],
)
def test_bad_input_ends_in_one_line_and_writes_nothing(copy, tmp_path, capsys, spoil, words):
    arrays, text, run = copy
    assert run(*spoil(arrays, text)) == 1
    assert_one_line(capsys, str(tmp_path), *words)
    assert sorted(os.listdir(tmp_path)) == ["log.npz", "setup.toml"]


@pytest.mark.parametrize(
    ("changed", "code", "words"),
    [
        ({"log": "absent.npz"}, 1, ["absent.npz", "check the path"]),
        ({"log": "log.bag7"}, 1, ["unknown format '.bag7'"]),
        ({"--setup": "absent.toml"}, 1, ["absent.toml", "give the path of a setup.toml"]),
        ({"-o": "out.txt"}, 2, ["--output: cannot write", "end the name in .npz"]),
        ({"-o": "absent/out.npz"}, 1, ["absent/out.npz", "the folder does not exist"]),
        ({"--plot": "absent/out.png"}, 1, ["absent/out.png", "the folder does not exist"]),
        ({"--plot": "out.bmp"}, 1, ["out.bmp", "cannot draw a '.bmp' file"]),
    ],
)
def test_bad_paths_end_in_one_line_and_write_nothing(demo, tmp_path, monkeypatch, capsys, changed, code, words):
    monkeypatch.chdir(tmp_path)
    files = {"log": demo[0] / "log.npz", "--setup": demo[0] / "setup.toml", "-o": "out.npz", **changed}
    log = str(files.pop("log"))
    assert main(["filter", log, *(str(x) for pair in files.items() for x in pair)]) == code
    assert_one_line(capsys, *words)
    assert os.listdir(tmp_path) == []


def test_a_demo_without_samples_is_refused(tmp_path, capsys):
    assert main(["demo", "-o", str(tmp_path / "new"), "--duration", "0.001"]) == 2
    assert_one_line(capsys, "--duration: 0.25 samples are no demonstration")
    assert os.listdir(tmp_path) == []


def test_an_interrupted_write_leaves_the_old_result(copy, tmp_path, monkeypatch, capsys):
    arrays, text, run = copy
    (tmp_path / "out.npz").write_bytes(b"an older result")

    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)  # written to the temporary file, not yet renamed
    assert run(arrays, text, "--force") == 1
    assert_one_line(capsys, "interrupted, nothing more was written")
    assert (tmp_path / "out.npz").read_bytes() == b"an older result"
    assert sorted(os.listdir(tmp_path)) == ["log.npz", "out.npz", "setup.toml"]


def test_a_misspelt_command_is_told_which_one_is_near(capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["diagnos", "log.npz"])
    assert "there is no command 'diagnos': did you mean 'diagnose'?" in capsys.readouterr().err
    with pytest.raises(SystemExit, match="2"):
        main(["xyzzy"])
    assert "choose from" in capsys.readouterr().err


def test_variables_of_jax_that_do_not_hold_here_are_ignored_with_a_word(monkeypatch, capsys):
    for name, value in (("JAX_ENABLE_X64", "junk"), ("JAX_DEBUG_NANS", "1")):
        monkeypatch.setenv(name, value)
    assert main(["setup", "--list"]) == 0
    said = capsys.readouterr().err
    assert said == "warning: JAX_DEBUG_NANS is ignored, because NaN means that nothing was measured\n"
    assert "JAX_ENABLE_X64" not in os.environ


def test_a_device_that_is_not_there_is_one_line(monkeypatch):
    def missing():
        raise RuntimeError("Unable to initialize backend 'cuda'")

    monkeypatch.setenv("JAX_PLATFORMS", "cuda")
    monkeypatch.setattr(jax, "devices", missing)
    with pytest.raises(UsageError, match=r"JAX_PLATFORMS: JAX cannot start on 'cuda': Unable to initialize"):
        prepare_jax()
