"""Pairs of logs of withheld kinds: their plan, their common properties, and the meaning of their labels."""

import json
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from validation.generator import recording
from validation.generator.kinds import likeness, logs
from validation.generator.kinds.plan import KINDS, LARGEST, SMALLEST, Job, chosen, make_plan
from validation.generator.make import Limits
from validation.generator.world import tool_path
from validation.labels import read_labels

LIMITS = Limits((4.0, 4.0), (100.0,), True)
JOBS = (Job("hose", "viscous", 2.0), Job("sag", "elastic", 0.5), Job("rough_bridge", "force", 1.5))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Three pairs of logs, from the jobs above."""
    path = tmp_path_factory.mktemp("kinds")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(logs, "make_plan", lambda which, count, seed: list(JOBS))
        logs.make_set(path, "seen", len(JOBS), 4, LIMITS)
    return path


def test_a_plan_has_all_kinds_and_forms_in_turn_and_spreads_the_sizes():
    for which in ("seen", "unseen", "all"):
        names = chosen(which)
        plan = make_plan(which, 2 * len(names), 5)
        assert Counter((job.kind, job.form) for job in plan) == {
            (name, form): 1 for name in names for form in KINDS[name].forms
        }
        sizes = np.sort([job.gap_sigmas for job in plan if KINDS[job.kind].drive != "noise"])
        assert SMALLEST <= sizes[0] < 2 * SMALLEST
        assert LARGEST / 2 < sizes[-1] <= LARGEST
        assert np.diff(np.log(sizes)).max() < 0.15 * np.log(LARGEST / SMALLEST)
    assert make_plan("all", 7, 1) == make_plan("all", 7, 1) != make_plan("all", 7, 2)


def test_both_logs_have_the_robot_and_the_effect_and_not_the_motion(folder):
    first, second = (json.loads((folder / place / "truth.json").read_text()) for place in ("", "second"))
    for index, job in enumerate(JOBS):
        name = f"log_{index:03d}"
        assert first[name]["effects"] == second[name]["effects"]
        assert list(first[name]["effects"]) == [job.kind]
        assert (folder / f"{name}.toml").read_text() == (folder / "second" / f"{name}.toml").read_text()
        q = [np.load(folder / place / f"{name}.npz")["q"] for place in ("", "second")]
        assert np.abs(q[0] - q[1]).max() > 0.05


def test_the_gap_is_as_large_as_asked_and_as_the_extra_wrench(folder):
    truth = json.loads((folder / "truth.json").read_text())
    for index, job in enumerate(JOBS):
        name = f"log_{index:03d}"
        entry, extra = truth[name], np.load(folder / "extra" / f"{name}.npz")
        sigma = np.array(entry["sigma"])
        line = np.stack([np.ones_like(extra["t"]), extra["t"]], 1)
        wrench = extra["wrench"] - line @ np.linalg.lstsq(line, extra["wrench"], rcond=None)[0]
        noise = ((extra["noise_std"] / sigma) ** 2 - 1).mean()
        gap = np.sqrt(noise) if job.kind == "rough_bridge" else np.sqrt(((wrench / sigma) ** 2).mean())
        assert entry["gap_sigmas"] == pytest.approx(gap)
        assert entry["gap_sigmas"] == pytest.approx(job.gap_sigmas, rel=logs.NEAR)
        assert (entry["term"]["oracle_shrink"] is None) == (job.kind == "rough_bridge")


@pytest.mark.parametrize(("seed", "sign"), [(4, 1), (5, -1)])
def test_less_its_extra_wrench_a_log_is_what_it_is_without_the_effect(tmp_path, monkeypatch, seed, sign):
    """This holds for either sign that the sensor reports; the noise is the same, because the seed is."""
    monkeypatch.setattr(logs, "random_scene", lambda *told: with_sign(recording.random_scene(*told), sign))
    kind, nothing = KINDS["hose"], lambda form, parameters, scene: {}
    for name, hooks in (("with", kind.hooks), ("without", nothing)):
        for place in (tmp_path / name / logs.EXTRA, tmp_path / name / logs.SECOND / logs.EXTRA):
            place.mkdir(parents=True)
        monkeypatch.setitem(KINDS, "hose", replace(kind, hooks=hooks))
        logs.make_pair(0, JOBS[0], seed, LIMITS, tmp_path / name)
    for place in ("", logs.SECOND):
        dirty, clean = (np.load(tmp_path / name / place / "log_000.npz")["wrench"] for name in ("with", "without"))
        extra = np.load(tmp_path / "with" / place / logs.EXTRA / "log_000.npz")["wrench"]
        assert np.abs(extra).max() > 0.05
        np.testing.assert_allclose(dirty - clean, extra, atol=1e-5)


def with_sign(scene, sign):
    reports = "wrench_on_tool" if sign > 0 else "wrench_on_sensor"
    return replace(scene, belief=replace(scene.belief, reports=reports))


def test_labels_are_read_back(folder):
    labels = read_labels(folder, [f"log_{i:03d}" for i in range(3)])
    hose, sag, bridge = (labels[f"log_{i:03d}"] for i in range(3))
    assert hose.group == "unlisted"
    assert (hose.withheld.kind, hose.withheld.form, hose.withheld.drive) == ("hose", "viscous", "velocity")
    assert set(hose.withheld.equivalent) <= {"joint_velocity"}
    assert sag.withheld.equivalent == ("load",)
    assert hose.withheld.coefficients == {"N_per_m_s": hose.effects["hose"]["drag"]}
    assert (sag.withheld.frame, sag.withheld.acts_as, sag.withheld.unseen) == ("sensor", "torque", True)
    assert bridge.withheld.oracle_shrink is None
    assert hose.withheld.oracle_shrink == pytest.approx(1.0, abs=0.05)


def test_the_same_seed_makes_the_same_pair(folder, tmp_path):
    for place in (tmp_path / logs.EXTRA, tmp_path / logs.SECOND / logs.EXTRA):
        place.mkdir(parents=True)
    logs.make_pair(1, JOBS[1], 4, LIMITS, tmp_path)
    for place in ("", "second"):
        one, other = (np.load(base / place / "log_001.npz") for base in (folder, tmp_path))
        for column in one.files:
            np.testing.assert_array_equal(one[column], other[column])


def test_another_drive_says_the_same_where_it_predicts_the_extra_wrench():
    scene = recording.random_scene("sines", 16.0, 100.0, 1.5, np.random.SeedSequence(3).spawn(4))
    dq = scene.motion(scene.stamps)[1]
    noise = scene.belief.noise_std
    follows = 3 * noise * (dq @ np.random.default_rng(0).normal(size=(dq.shape[1], 6)))
    assert likeness.says_the_same("joint_velocity", follows, scene)
    assert not likeness.says_the_same("orientation", follows, scene)
    path = tool_path(scene.world, scene.motion, scene.stamps)
    assert likeness.says_the_same("orientation", noise * np.repeat(path.rotation[:, 0], 2, axis=1), scene)
    omega = np.gradient(path.rotation, path.t, axis=0).transpose(0, 2, 1) @ path.rotation
    turning = noise * np.repeat(omega[:, [0, 0, 1], [1, 2, 2]], 2, axis=1)
    assert likeness.says_the_same("angular_velocity", turning, scene)
    assert not likeness.says_the_same("orientation", turning, scene)


def test_a_predicted_share_is_of_what_a_line_leaves():
    t = np.arange(0, 20, 0.05)
    wave, other = np.sin(t)[:, None], np.random.default_rng(0).normal(size=(len(t), 1))
    wrench = wave * np.ones(6) + 1000 * t[:, None]
    assert likeness.predicted_share(t, wave, wrench) > 1 - 1e-9
    assert likeness.predicted_share(t, other, wrench) < 0.1
    assert likeness.predicted_share(t, wave, wrench + other) == pytest.approx(0.5 / 1.5, abs=0.1)


def test_an_oracle_is_left_with_the_noise():
    sigma = np.full(6, 0.1)
    assert logs.oracle_shrink(2.0, sigma, sigma) == 1.0
    assert logs.oracle_shrink(1.0, 1.1 * sigma, sigma) == pytest.approx(1 - 0.21 / 1.21)
    assert logs.oracle_shrink(0.0, sigma, sigma) == 1.0
