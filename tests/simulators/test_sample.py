import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from made_scenes import write

from ftbias_jax.cli.commands.simulators import export
from ftbias_jax.cli.main import main
from ftbias_jax.diagnosis.result import Candidate
from ftbias_jax.errors import LogError
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.setup import load_setup
from ftbias_jax.setup.mjcf import load_mjcf
from ftbias_jax.simulators.sample import draw, names_of, posterior_of, ranges, with_rest

ROOT = np.array([[1.0, 0, 0], [0.8, 0.6, 0], [0, 0, 1.0]])
CORRELATION = np.pad(ROOT @ ROOT.T, ((0, 1), (0, 1)))
CORRELATION[3, 3] = 1.0


def cause(effect, parameters, stderr, twins=(), behind=None):
    words = dict.fromkeys(("stage", "explanation", "remedy"), "")
    numbers = dict.fromkeys(("held_out_gain", "held_out_gain_stderr", "shrink"), 0.5)
    named = {"effect": effect, "parameters": parameters, "stderr": stderr, "indistinguishable_from": twins}
    return Candidate(**named, **words, **numbers, separate_by=(), behind=behind, units={}, nominal={})


def made(behind=0.01):
    """A mass and a cutoff with correlated errors, a delay near a bound, a number without error; a twin of the mass."""
    causes = (
        cause("tool_mass", {"mass": 0.8}, {"mass": 0.01}, twins=("gain",)),
        cause("low_pass", {"cutoff": 9.0}, {"cutoff": 0.5}),
        cause("time_delay", {"delay": 1.99}, {"delay": 0.05}),
        cause("stamp_jitter", {"std": 1e-3}, {}),
    )
    twin = cause("gain", {"gain": [1.1] * 6}, {"gain": [0.01] * 6}, behind=behind)
    content = {
        "verdict": "explained",
        "causes": [one._asdict() for one in causes],
        "terms": [],
        "posterior": {"correlation": CORRELATION.tolist()},
        "candidates": [twin._asdict()],
        "provenance": {"duration": 60.0},
    }
    return causes, content


def test_draws_scatter_as_the_posterior_within_the_bounds():
    causes, content = made(behind=99.0)
    posterior = posterior_of(causes, content, CATALOGUE)
    assert posterior.names == ("tool_mass.mass", "low_pass.cutoff", "time_delay.delay", "stamp_jitter.std")
    rng = np.random.default_rng(0)
    draws = np.array([[v for one in draw(posterior, rng) for v in one.parameters.values()] for _ in range(4000)])
    np.testing.assert_allclose(draws[:, :2].mean(0), [0.8, 9.0], rtol=2e-3)
    np.testing.assert_allclose(draws[:, :2].std(0), [0.01, 0.5], rtol=0.05)
    assert abs(np.corrcoef(draws[:, :2].T)[0, 1] - 0.8) < 0.03
    assert draws[:, 2].max() <= 2.0
    assert draws[:, 2].max() > 1.99
    np.testing.assert_array_equal(draws[:, 3], 1e-3)


def test_a_twin_stands_in_as_often_as_its_odds_say():
    causes, content = made(behind=0.02)
    posterior = posterior_of(causes, content, CATALOGUE)
    expected = np.exp(-0.02 * 60) / (1 + np.exp(-0.02 * 60))
    rng = np.random.default_rng(1)
    drawn = [draw(posterior, rng)[0] for _ in range(2000)]
    assert abs(np.mean([one.effect == "gain" for one in drawn]) - expected) < 0.04
    gains = np.array([one.parameters["gain"] for one in drawn if one.effect == "gain"])
    np.testing.assert_allclose(gains.mean(0), 1.1, atol=0.003)
    found = ranges(posterior, [draw(posterior, rng) for _ in range(400)])
    assert found["mixture"][1]["cause"] == "gain"
    assert found["mixture"][1]["odds"] == pytest.approx(expected)
    assert abs(found["high"][0] - found["low"][0] - 2 * 1.96 * 0.01) < 0.006


def test_what_is_left_of_the_gap_is_correlated_noise_of_every_sample(tmp_path):
    setup = load_setup(write(tmp_path)[1])
    rms = {name: {"rms": [x, 0.05, 0.05, 0.002, 0.002, 0.002]} for name, x in (("before", 0.5), ("after", 0.13))}
    content = {
        "gap": {**rms, "noise_floor": [0.05] * 3 + [0.002] * 3},
        "where": {"bands": [[0, 0.1, 0.2], [0.1, 0.3, 0.8]]},
    }
    sensor = with_rest(setup, content).sensor
    np.testing.assert_allclose(sensor.correlated_std, [0.12, 0, 0, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(sensor.correlated_time, 1 / (2 * np.pi * 0.2))
    # A sample contains no terms: their share of the gap remains, too.
    term = with_rest(setup, content | {"terms": [{"drive": "velocity", "shrink": 0.9}]}).sensor
    assert term.correlated_std[0] == pytest.approx(np.sqrt(0.12**2 + 0.9 * (0.5**2 - 0.05**2)))
    own = with_rest(replace(setup, sensor=sensor), content).sensor
    np.testing.assert_allclose(own.correlated_std[0], 0.12 * np.sqrt(2))
    assert with_rest(setup, {}) is setup
    faint = {**content, "gap": {**content["gap"], "after": content["gap"]["before"] | {"rms": [0.0501, 0, 0, 0, 0, 0]}}}
    assert with_rest(setup, faint) is setup


def test_numbers_of_lists_have_names_of_their_own():
    assert names_of([cause("gain", {"gain": [1.0] * 6}, {})]) == tuple(f"gain.gain[{i}]" for i in range(6))


@pytest.mark.parametrize("stated", [None, {"correlation": [[1.0]]}, {"correlation": [[None] * 4] * 4}])
def test_a_diagnosis_without_a_joint_posterior_is_refused(stated):
    causes, content = made()
    with pytest.raises(LogError, match="has no joint posterior"):
        posterior_of(causes, content | {"posterior": stated}, CATALOGUE, "found.json")


def test_the_command_writes_scenes_sensors_and_ranges(tmp_path, capsys, monkeypatch):
    compiled = []
    monkeypatch.setattr(export, "load_mjcf", lambda *names: compiled.append(names) or load_mjcf(*names))
    scene, setup = write(tmp_path)
    (tmp_path / "found.json").write_text(json.dumps(made(behind=99.0)[1]))
    words = [
        "sample",
        tmp_path / "found.json",
        "--setup",
        setup,
        "--like",
        scene,
        "--count",
        "3",
        "-o",
        tmp_path / "out",
    ]
    assert main(list(map(str, words))) == 0
    assert compiled == [(str(scene), "", "")]  # once for all draws
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == [*(f"{i:03d}{end}" for i in range(3) for end in (".xml", "_sensor.toml")), "ranges.json"]
    masses = []
    for i in range(3):
        model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / f"{i:03d}.xml"))
        masses.append(model.body_subtreemass[model.body("hand").id])
    assert len(set(np.round(masses, 6))) == 3
    np.testing.assert_allclose(masses, 0.8, atol=0.05)
    assert json.loads((tmp_path / "out" / "ranges.json").read_text())["parameters"][0] == "tool_mass.mass"
    assert main(list(map(str, words))) == 2
    assert "is not empty" in capsys.readouterr().err


def test_a_folder_that_holds_something_is_left_as_it_is(tmp_path, capsys):
    (tmp_path / "000.xml").write_text("somebody's")
    assert main(["sample", "found.json", "--setup", "setup.toml", "-o", str(tmp_path)]) == 2
    assert "is not empty" in capsys.readouterr().err
    assert [path.read_text() for path in tmp_path.iterdir()] == ["somebody's"]
