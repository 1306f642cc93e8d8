"""Many logs in one call: each result is that of the log alone, and a bad log does not affect the others."""

import tomllib

import jax
import numpy as np
import pytest
import small_archive

import ftbias_jax as ft
from ftbias_jax.filtering.method import runs
from ftbias_jax.filtering.method.filter_samples import filter_each
from ftbias_jax.filtering.verbs import from_setup

LENGTHS = (4.0, 1.0, 3.1)  # s


@pytest.fixture(scope="module")
def setup():
    return ft.parse_setup(tomllib.loads(small_archive.SETUP), "setup.toml")


@pytest.fixture(scope="module")
def logs(setup):
    return [ft.simulate(setup, duration=seconds, rate=50, seed=i).log for i, seconds in enumerate(LENGTHS)]


@pytest.fixture(scope="module")
def folder(setup, logs, tmp_path_factory):
    """The logs as files, with an unreadable one in the middle."""
    folder = tmp_path_factory.mktemp("logs")
    for i, log in enumerate(logs):
        np.savez(folder / f"{i}.npz", t=log.t, q=log.q, dq=log.dq, wrench=log.wrench)
    (folder / "1b.npz").write_bytes(b"no archive")
    return folder


@pytest.fixture(scope="module")
def together(setup, folder):
    done = []
    results = ft.filter_log(setup, sorted(folder.iterdir()), fields=["bias", "bias_std"], progress=done.append)
    return results, done


def test_each_result_is_that_of_the_log_alone(setup, logs):
    together = ft.filter_log(setup, iter(logs))
    assert len(together) == len(logs)
    assert not together.errors
    for log, result in zip(logs, together, strict=True):
        alone = ft.filter_log(setup, log)
        for name in ("t", "bias", "bias_std", "drift", "wrench_tool", "innovation", "log_likelihood"):
            np.testing.assert_allclose(getattr(result, name), getattr(alone, name), rtol=1e-12, atol=1e-12)
        assert str(result) == str(alone)


def test_sets_of_logs_are_done_as_one_program_where_there_is_an_accelerator(setup, folder, logs, monkeypatch, together):
    """Logs of any lengths, more than are held at a time, one of which cannot be read."""
    given = [*sorted(folder.iterdir()), *logs[:2]]
    alone = ft.filter_log(setup, given)
    sizes, done = [], []

    def noted(params, samples, **named):
        sizes.append(len(samples.dt))
        return filter_each(params, samples, **named)

    monkeypatch.setattr(from_setup, "accelerator", lambda: jax.devices()[0])
    monkeypatch.setattr(runs, "filter_each", noted)
    monkeypatch.setattr(runs, "SET_SAMPLES", 1600)
    found = ft.filter_log(setup, given, progress=done.append)
    assert sizes == [4, 1]
    assert done == sorted(done)
    assert done[-1] == sum(len(x.t) for x in alone if x is not None)
    assert [*found.errors] == [*alone.errors] == [2]
    for a, b in zip(found, alone, strict=True):
        assert str(a) == str(b)
        if a is not None:
            np.testing.assert_allclose(a.bias, b.bias, rtol=1e-9, atol=1e-9)


def test_a_bad_log_is_named_and_the_others_have_their_results(together, folder):
    results, _ = together
    assert [result is None for result in results] == [False, False, True, False]
    assert [*results.errors] == [2]
    assert results.errors[2].file == str(folder / "1b.npz")
    assert "3 of 4 logs filtered: 405 wrench samples" in str(results)
    assert f"log 2 has no result: {folder / '1b.npz'}" in str(results)
    assert results[1:3] == results.results[1:3]


def test_progress_counts_the_samples_of_all_logs(together):
    _, done = together
    assert done == sorted(done)
    assert done[-1] == round(50 * sum(LENGTHS))


def test_only_the_fields_that_are_asked_for_are_kept(setup, logs, together, tmp_path):
    (result, *_), _ = together
    whole = ft.filter_log(setup, logs[0])
    np.testing.assert_allclose(result.bias, whole.bias, rtol=1e-12)
    assert result.log_likelihood == pytest.approx(whole.log_likelihood)
    assert result.nis is result.wrench_tool is result.in_contact is None
    assert str(result) == str(whole)
    result.save(tmp_path / "out.npz")
    assert {"t", "bias", "bias_std"} <= {*np.load(tmp_path / "out.npz").files}
    assert "nis" not in np.load(tmp_path / "out.npz").files
    with pytest.raises(ft.UsageError, match=r"fields: check needs innovation, which was not kept"):
        result.check()


def test_a_path_is_a_log(setup, folder, logs):
    np.testing.assert_array_equal(ft.filter_log(setup, folder / "1.npz").bias, ft.filter_log(setup, logs[1]).bias)


@pytest.mark.parametrize(
    ("logs", "fields", "words"),
    [([], (), "logs: there is no log"), (["none.npz"], ["bais"], "fields: there is no field 'bais'")],
)
def test_what_cannot_be_asked_for_is_said(setup, logs, fields, words):
    with pytest.raises(ft.UsageError) as caught:
        ft.filter_log(setup, logs, fields=fields)
    assert str(caught.value).startswith(words)
