"""Logs with pauses, clock jumps or odd sizes: cost grows with the samples, and what is wrong is reported."""

import numpy as np
import pytest
from bounded import bounded
from small_archive import SETUP, write_log

from ftbias_jax.check.regression import KNOT, make_layout
from ftbias_jax.cli.main import main
from ftbias_jax.io import read_log
from ftbias_jax.io.cleaning import without_long_pauses
from ftbias_jax.io.log import Column
from ftbias_jax.io.stamps.clock import LONG_PAUSE
from ftbias_jax.setup import load_setup

SAMPLES = 1200
DAY, YEAR, UNIX = 86_400.0, 3.0e7, 1.7e9
WORDS = {
    "info": "info log.npz --setup setup.toml",
    "check": "check log.npz --setup setup.toml",
    "filter": "filter log.npz --setup setup.toml -o out.npz --check",
    "identify": "identify log.npz --setup setup.toml -o out.toml --unchecked --bias",
    "diagnose": "diagnose log.npz --setup setup.toml --unchecked",
    "tune": "tune log.npz --setup setup.toml -o out.toml --unchecked",
}


@pytest.fixture
def paused(tmp_path, monkeypatch):
    """Write a log that pauses for ``pause`` s before a sample, or has other arrays."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "setup.toml").write_text(SETUP)
    write_log(tmp_path / "log.npz", samples=SAMPLES)
    arrays = dict(np.load("log.npz"))

    def write(pause=0.0, place=1, **changes):
        t = arrays["t"].copy()
        t[place:] += pause
        np.savez("log.npz", **{**arrays, "t": t, **changes})
        return {**arrays, "t": t}

    return write


@pytest.mark.parametrize("pause", [5.0, YEAR, UNIX])
@pytest.mark.parametrize("place", [1, SAMPLES // 2, SAMPLES - 1])
@pytest.mark.parametrize("command", ["info", "check"])
def test_commands_that_only_look_take_no_longer(paused, capsys, command, pause, place):
    paused(pause, place)
    with bounded(10, 256):
        assert main(WORDS[command].split()) == 0


@pytest.mark.slow
@pytest.mark.parametrize("pause", [DAY, UNIX])
@pytest.mark.parametrize("place", [1, SAMPLES // 2, SAMPLES - 1])
@pytest.mark.parametrize("command", ["filter", "identify", "diagnose", "tune"])
def test_commands_that_fit_take_no_longer(paused, capsys, command, pause, place):
    paused(pause, place)
    with bounded(np.inf, 1536):  # including compiled programs
        assert main(WORDS[command].split()) in (0, 1, 3)
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize("pause", [DAY, UNIX])
def test_what_follows_a_pause_is_filtered_with_a_bias_of_its_own(paused, capsys, pause):
    """The same log without and with another bias after the pause: the estimates differ by exactly that."""
    half, step = SAMPLES // 2, np.array([3, -2, 1, 0.3, 0.2, 0.1])
    arrays, found = paused(pause, half), []
    for size in (0, 1):
        wrench = arrays["wrench"] + size * step * (np.arange(SAMPLES) >= half)[:, None]
        paused(pause, half, wrench=wrench)
        assert main(["filter", "log.npz", "--setup", "setup.toml", "-o", "out.npz", "--as-stated"]) in (0, 3)
        with np.load("out.npz") as out:
            found.append(np.array(out["bias"], float))
            assert len(out["t"]) == SAMPLES
            np.testing.assert_allclose(np.diff(out["t"]).max(), pause, rtol=1e-3)
    change = found[1] - found[0]
    np.testing.assert_allclose(change[:half], 0, atol=1e-6)
    np.testing.assert_allclose(change[half + 200 :], np.tile(-step, (half - 200, 1)), atol=0.02)


@pytest.mark.parametrize("stamp", [1e30, -1e30, 1e308])
def test_a_stamp_that_no_clock_has_is_left_out_and_told(paused, stamp):
    paused(t=np.r_[paused()["t"][:-1], stamp])
    log = read_log("log.npz", load_setup("setup.toml"))
    assert len(log.t) == SAMPLES - 1
    assert any("centuries" in repair.what and repair.lost for repair in log.repairs)


@pytest.mark.parametrize("t", [np.full(SAMPLES, 1e308), np.linspace(1e308, 1.7e308, SAMPLES), np.full(SAMPLES, -1e300)])
def test_stamps_that_all_are_no_time_are_refused(paused, capsys, t):
    paused(t=t)
    assert main(WORDS["check"].split()) == 1
    assert "the stamps are about" in capsys.readouterr().err


def test_the_bias_of_the_check_has_knots_by_the_bins_not_by_the_span():
    t = np.concatenate([np.arange(0, 60, 0.1), np.arange(0, 60, 0.1) + YEAR])
    layout = make_layout(t, np.zeros(len(t), int), np.ones(6, bool))
    assert layout.basis.shape[1] <= 2 + 4 * KNOT / KNOT
    before = make_layout(t[:600], np.zeros(600, int), np.ones(6, bool))
    assert before.basis.shape[1] == 2 + int(59.9 // KNOT)
    # Levels before and after the pause are independent of each other.
    step = np.repeat([0.0, 1.0], 600)
    fitted = layout.basis @ np.linalg.lstsq(layout.basis, step, rcond=None)[0]
    assert np.abs(fitted - step).max() < 0.35


def test_long_pauses_are_shortened_with_all_that_has_times(paused):
    paused(DAY, SAMPLES // 2)
    log = read_log("log.npz", load_setup("setup.toml"))
    log = log._replace(columns={"x": Column(log.t, log.q[:, 0])}, rezeroed_at=(float(log.t[-1]),))
    short = without_long_pauses(log)
    assert np.diff(short.t).max() == pytest.approx(LONG_PAUSE)
    np.testing.assert_allclose(np.diff(short.t)[: SAMPLES // 2 - 1], np.diff(log.t)[: SAMPLES // 2 - 1])
    np.testing.assert_allclose(short.columns["x"].t, short.t)
    assert short.rezeroed_at == (pytest.approx(short.t[-1]),)
    assert without_long_pauses(short) is short or np.array_equal(without_long_pauses(short).t, short.t)


@pytest.mark.parametrize("samples", [2, 3, 30])
def test_a_log_that_is_too_short_for_a_diagnosis_says_so(paused, capsys, samples):
    paused(**{name: values[:samples] for name, values in paused().items()})
    assert main(WORDS["diagnose"].split()) == 1
    assert "too short to tell a gap from the bias" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["t", "q", "wrench"])
def test_an_array_that_is_one_number_is_an_error_of_ours(paused, capsys, name):
    paused(**{name: np.float64(3.0)})
    for words in ("info log.npz", WORDS["check"]):
        assert main(words.split()) in (0, 1)
        assert "Traceback" not in capsys.readouterr().err


def test_a_wrench_that_nothing_measures_is_refused(paused, capsys):
    wrench = paused()["wrench"]
    wrench[500, 2] = 1e30
    paused(wrench=wrench)
    assert main(WORDS["check"].split()) == 1
    assert "wrench[500, 2] is 1e+30, which nothing measures" in capsys.readouterr().err
