"""Logs of one robot over time: the day on which a cause began, and its size in each log."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import ftbias_jax as ft
from ftbias_jax.cli.main import main
from ftbias_jax.diagnosis import pooled
from ftbias_jax.diagnosis.report.as_json import load_courses
from ftbias_jax.diagnosis.result import ALL_ALONG, AT_ONCE, GROWING
from ftbias_jax.errors import LogError, UsageError

DAY = 86400.0
DATES = 1.76e9 + DAY * np.arange(40)


def shares_of(shape, seed, stderr=0.05, scatter=0.1):
    rng = np.random.default_rng(seed)
    return shape * (1 + scatter * rng.normal(size=len(shape))) + stderr * rng.normal(size=len(shape))


@given(first=st.integers(4, 34), seed=st.integers(0, 1000), before=st.sampled_from([0.0, 0.3]))
def test_a_cause_that_is_there_at_once_begins_on_its_day(first, seed, before):
    share = before + shares_of((np.arange(40) >= first).astype(float), seed)
    course = pooled.course_of(DATES, "gain", share, np.full(40, 0.05))
    assert course.begins == AT_ONCE
    assert course.since == DATES[first]
    assert course.earliest < course.since <= course.latest
    assert course.before == pytest.approx(before, abs=0.15)


@given(first=st.integers(4, 28), seed=st.integers(0, 1000))
def test_a_growing_cause_begins_within_days(first, seed):
    grown = np.clip((np.arange(40) - first + 1) / (40 - first), 0, None)
    course = pooled.course_of(DATES, "gain", shares_of(grown, seed), np.full(40, 0.05))
    assert course.begins == GROWING
    assert abs(course.since - DATES[first]) <= 5 * DAY
    assert course.latest - course.earliest < 20 * DAY


@given(seed=st.integers(0, 1000))
def test_what_is_always_there_has_no_day(seed):
    course = pooled.course_of(DATES, "gain", shares_of(np.ones(40), seed), np.full(40, 0.05))
    assert course.begins == ALL_ALONG
    assert course.before == pytest.approx(1, abs=0.1)


def test_shares_are_least_squares_with_errors_of_blocks():
    rng = np.random.default_rng(0)
    columns, truth = rng.normal(size=(2, 3000, 6)), np.array([0.7, -0.2])
    error = np.tensordot(-truth, columns, 1) + rng.normal(size=(3000, 6))
    share, stderr = pooled.share_in(columns, error, np.arange(3000) // 100)
    wanted = np.linalg.lstsq(columns.reshape(2, -1).T, -error.ravel(), rcond=None)[0]
    np.testing.assert_allclose(share, wanted, rtol=1e-6)
    np.testing.assert_allclose(stderr, 1 / np.sqrt(18000), rtol=0.5)
    assert np.abs(share - truth).max() < 5 * stderr.max()


def test_a_cause_that_a_log_does_not_show_has_a_share_of_no_weight():
    share, stderr = pooled.share_in(np.zeros((1, 200, 6)), np.ones((200, 6)), np.arange(200) // 100)
    assert np.isfinite(share).all()
    assert stderr[0] > 1e6


@pytest.mark.slow
def test_logs_together_name_the_cause_and_its_first_day(setup, tmp_path, capsys):
    """Sixteen logs of 12 s, the last six with another gain; their order is that of the stamps, not of the names."""
    setup = replace(setup, sensor=replace(setup.sensor, noise_std=4 * setup.sensor.noise_std))
    (tmp_path / "cell.toml").write_text(ft.dump_setup(setup))
    logs = [tmp_path / f"{name}.npz" for name in np.random.default_rng(0).permutation(16)]
    for number, path in enumerate(logs):
        effects = {"gain": {"gain": [1.06, 1.0, 0.95, 1.0, 1.0, 1.0]}} if number >= 10 else {}
        log = ft.simulate(setup, effects, duration=12.0, rate=100.0, seed=number).log
        np.savez(path, t=DATES[number] + log.t, q=log.q, dq=log.dq, wrench=log.wrench)
    pooled_json, page = str(tmp_path / "out.pooled.json"), str(tmp_path / "page.html")
    words = ["diagnose", str(tmp_path / "*.npz"), "--setup", str(tmp_path / "cell.toml"), "--pool", "by=robot"]
    assert main([*words, "--json", pooled_json, "--html", page]) == 0
    assert "gain: since 2025-10-1" in capsys.readouterr().out
    assert "Since when" in Path(page).read_text()
    content = json.loads(Path(pooled_json).read_text())
    assert [cause["effect"] for cause in content["causes"]] == ["gain"]
    assert content["logs"] == [path.name for path in logs[12:]]
    name, (course,) = load_courses(pooled_json)
    assert (name, course.effect, course.begins) == ("cell.toml", "gain", AT_ONCE)
    assert abs(course.since - DATES[10]) <= DAY
    assert course.earliest < DATES[10] <= course.latest
    np.testing.assert_allclose(course.share[:10], 0, atol=0.3)
    np.testing.assert_allclose(course.share[10:], 1, atol=0.3)


def test_a_few_logs_are_too_few(setup):
    log = ft.Log.from_arrays(
        setup, 0.01 * np.arange(40), np.zeros((40, 7)), np.random.default_rng(0).normal(size=(40, 6))
    )
    with pytest.raises(UsageError, match="got 2 logs"):
        ft.diagnose_pooled(setup, [log, log])


@pytest.mark.parametrize("text", ["{}", '{"courses": [{"effect": "gain"}], "provenance": {"setup": {"name": "a"}}}'])
def test_other_files_are_no_pooled_diagnosis(tmp_path, text):
    (tmp_path / "some.pooled.json").write_text(text)
    with pytest.raises(LogError, match="is no diagnosis of pooled logs"):
        load_courses(str(tmp_path / "some.pooled.json"))
