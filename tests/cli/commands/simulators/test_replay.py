"""The workflow for a simulator: replay, diagnose against it, correct it, validate it on another log."""

import json
from dataclasses import replace

import made_scenes
import numpy as np
import pytest

from ftbias_jax.cli.main import main
from ftbias_jax.model.simulate_log import simulate
from ftbias_jax.setup import load_setup
from ftbias_jax.setup.mjcf import load_mjcf
from ftbias_jax.simulators.mend_mjcf import mend_mjcf
from ftbias_jax.simulators.replay import replay

TILT = {"gravity_tilt": {"gravity": [0.0, 0.6, -9.79]}}


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    """A folder with the user's scene, its setup, and two logs of a robot whose base is tilted."""
    folder = tmp_path_factory.mktemp("cell")
    scene, path = made_scenes.write(folder)
    setup = load_setup(path)
    real = mend_mjcf(replace(setup, effects=TILT), load_mjcf(scene), str(folder / "real.xml"))
    (folder / "real.xml").write_text(next(iter(real.files.values())))
    for seed, name in enumerate(("monday", "tuesday")):
        made = simulate(setup, {}, duration=20, rate=200, seed=seed)
        states = np.stack([made.truth.q, made.truth.dq, made.truth.ddq], 2)
        wrench = replay(load_mjcf(folder / "real.xml"), made.log.t, states)
        recorded = replace(made, log=made.log._replace(wrench=wrench + made.log.wrench - made.truth.wrench_tool))
        recorded.save(folder / f"{name}.npz")
    return folder


def run(cell, command, *words):
    return main([command, *(str(cell / word) if "." in word else word for word in words)])


@pytest.mark.slow
def test_from_a_recording_to_a_mended_scene_that_another_recording_confirms(cell, capsys):
    assert run(cell, "replay", "monday.npz", "--setup", "setup.toml", "-o", "sim.npz") == 0
    with np.load(cell / "sim.npz") as sim:
        assert sim["wrench_model"].shape == (len(sim["t"]), 6)
    words = ("--setup", "setup.toml", "--against", "sim.npz", "--json", "found.json")
    assert run(cell, "diagnose", "monday.npz", *words) == 0
    assert json.loads((cell / "found.json").read_text())["causes"][0]["effect"] == "gravity_tilt"
    words = ("--setup", "setup.toml", "--format", "mjcf", "--like", "scene.xml", "-o", "mended.xml")
    assert run(cell, "export", "found.json", *words) == 0
    words = ("--setup", "setup.toml", "--found", "found.json", "--mended", "mended.xml", "--json", "score.json")
    capsys.readouterr()
    assert run(cell, "validate-sim", "tuesday.npz", *words) == 0
    assert "the gap shrinks by" in capsys.readouterr().out
    score = json.loads((cell / "score.json").read_text())
    assert score["shrink"] > 0.9
    assert score["before"]["sigmas"] > 1


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (("replay", "monday.npz", "--setup", "beside.toml", "-o", "x.npz"), 1, "beside the scene's site"),
        (("replay", "monday.npz", "--setup", "panda.toml", "-o", "x.npz"), 2, "--mjcf SCENE.xml"),
        (("replay", "monday.npz", "--setup", "setup.toml", "-o", "monday.npz"), 2, "same file"),
        (
            ("diagnose", "monday.npz", "tuesday.npz", "--setup", "setup.toml", "--against", "sim.npz"),
            2,
            "give one for each log",
        ),
    ],
)
def test_mistakes_end_in_one_line(cell, capsys, words, code, message):
    text = made_scenes.TOML.replace("[sensor]", "[sensor]\ntranslation = [0.0, 0.0, 0.1]")
    (cell / "beside.toml").write_text(text)
    (cell / "panda.toml").write_text('[robot]\nmodel = "panda"\n[sensor]\nnoise_std = 0.1\n')
    assert run(cell, *words) == code
    printed = capsys.readouterr().err
    assert printed.count("\n") == 1
    assert message in printed
