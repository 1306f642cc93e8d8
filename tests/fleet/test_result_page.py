"""The page of one filtered log, and files that are no results."""

import json

import numpy as np
import pytest

from ftbias_jax.cli.main import main
from ftbias_jax.errors import LogError
from ftbias_jax.fleet.result_page import read_result, result_page

T = 400


def arrays(**changes):
    rng = np.random.default_rng(0)
    bias = np.cumsum(rng.normal(0, 0.01, (T, 6)), 0)
    origin = {
        "version": "1.2.3",
        "date": "2026-01-02",
        "logs": [{"name": "<b>log.npz"}],
        "setup": {"name": "setup.toml", "sha256": "abc"},
    }
    base = {
        "t": 0.01 * np.arange(T),
        "bias": bias,
        "bias_std": np.full((T, 6), 0.02),
        "wrench_unbiased": rng.normal(0, 0.1, (T, 6)),
        "wrench_tool": np.zeros((T, 6)),
        "used": np.arange(T) % 4 > 0,
        "provenance": np.array(json.dumps(origin)),
    }
    return {name: value for name, value in (base | changes).items() if value is not None}


def test_the_page_has_the_bias_at_the_end_with_its_error_and_where_it_is_from():
    made = arrays()
    page = result_page(made, "Bias of <out>.npz")
    assert f"fx {made['bias'][-1, 0]:.3f} ± 0.020 N" in page
    assert "75 % of the samples used" in page
    assert page.count("<svg") == 6
    assert "&lt;b&gt;log.npz" in page
    assert "<out>" not in page
    assert "<script" not in page


@pytest.mark.parametrize("text", [None, np.array("no JSON"), np.array("[1]"), np.array("[" * 99999)])
def test_a_result_that_says_nothing_of_itself_still_has_a_page(text):
    page = result_page(arrays(provenance=text), "a log")
    assert "Channel by channel" in page
    assert "Where this comes from" not in page


@pytest.mark.parametrize(
    "changes",
    [
        {"bias": None},
        {"bias_std": np.zeros((T, 5))},
        {"t": np.zeros(0)},
        {"t": np.zeros(())},
        {"wrench_tool": np.zeros(6)},
    ],
)
def test_what_is_no_result_is_refused(tmp_path, changes):
    np.savez(tmp_path / "out.npz", **arrays(**changes))
    with pytest.raises(LogError, match="is no result"):
        read_result(tmp_path / "out.npz")


def test_the_command_writes_the_page_and_keeps_the_result(tmp_path, capsys):
    np.savez(tmp_path / "out.npz", **arrays())
    before = (tmp_path / "out.npz").read_bytes()
    assert main(["report", str(tmp_path / "out.npz"), "-o", str(tmp_path / "out.html")]) == 0
    assert "wrote " in capsys.readouterr().out
    assert "Bias at the end" in (tmp_path / "out.html").read_text()
    assert (tmp_path / "out.npz").read_bytes() == before
    assert main(["report", str(tmp_path / "log.npz"), "-o", str(tmp_path / "out.html")]) != 0
