"""Logs diagnosed and tools identified separately: each as in a single call, here and by an executor."""

from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
from small_archive import SETUP, write_log

import ftbias_jax as ft
from ftbias_jax.commissioning import each


@pytest.fixture
def logs(tmp_path):
    (tmp_path / "setup.toml").write_text(SETUP)
    paths = [str(tmp_path / f"{seed}.npz") for seed in range(2)]
    for seed in range(2):
        write_log(tmp_path / f"{seed}.npz", seed, samples=600)
    return ft.load_setup(tmp_path / "setup.toml"), [*paths, str(tmp_path / "none.npz")]


def test_each_log_is_given_to_its_verb_and_errors_are_told(logs, monkeypatch):
    setup, paths = logs
    calls = []

    def diagnose(setup, log, **choices):
        calls.append(((setup, log), choices))
        if log == paths[2]:
            raise ft.LogError("is not there", file=log)
        return len(calls)

    monkeypatch.setattr(each, "diagnose", diagnose)
    memory = ft.read_log(paths[0], setup)
    found = ft.diagnose_each(setup, [*paths, memory], without=["gain"])
    assert list(found) == [1, 2, None, 4]
    assert found.errors[2].file.endswith("none.npz")
    assert [given[1] for given, _ in calls] == [*paths, memory]
    assert calls[0][1] == {"without": ["gain"]}
    assert (list(ft.diagnose_each(setup, paths[0])), list(ft.diagnose_each(setup, memory))) == ([5], [6])


@pytest.mark.slow
def test_tools_are_those_of_each_log_by_itself(logs):
    setup, paths = logs
    with ThreadPoolExecutor(2) as executor:
        found = ft.identify_each(setup, iter(paths), executor=executor, unchecked=True)
    for path, result in zip(paths[:2], found[:2], strict=True):
        alone = ft.identify_tool(setup, ft.read_log(path, setup), unchecked=True)
        assert result.setup.tool.mass == pytest.approx(alone.setup.tool.mass, rel=1e-9)
    assert found.errors.keys() == {2}


@pytest.mark.slow
def test_diagnoses_are_those_of_each_log_by_itself(logs):
    setup, paths = logs
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as executor:
        found = ft.diagnose_each(setup, paths, executor=executor, without=["gain"])
    alone = ft.diagnose(setup, [ft.read_log(paths[1], setup, raw=True)], ["1.npz"], without=["gain"])
    assert (found[1].verdict, found[1].logs) == (alone.verdict, ("1.npz",))
    np.testing.assert_allclose(found[1].gap.after_rms, alone.gap.after_rms, rtol=1e-6)
    assert ("gain", "left out on request") in found[0].not_tested
    assert found.errors.keys() == {2}
