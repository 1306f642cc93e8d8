"""``ftbias export`` into a simulator's own file."""

import json

import made_scenes
import mujoco
import numpy as np
import pytest

from ftbias_jax import __version__
from ftbias_jax.cli.main import main
from ftbias_jax.simulators.sensor_file import load_sensor_model

CAUSE = {
    "effect": "tool_mass",
    "stage": "tool",
    "indistinguishable_from": [],
    "separate_by": [],
    "parameters": {"mass": 0.9},
    "stderr": {"mass": 0.01},
    "held_out_gain": 1.0,
    "held_out_gain_stderr": 0.1,
    "shrink": 0.9,
    "explanation": "",
    "remedy": "",
}
BALANCED = {"frequency": 9.0, "damping_ratio": 0.1, "sagging": 0.0}
"""Springs without sag under the weight; those of MuJoCo sag."""
OTHERS = (("low_pass", {"cutoff": 9.0}), ("tool_flexibility", BALANCED))


@pytest.fixture
def cell(tmp_path):
    made_scenes.write(tmp_path)
    causes = [CAUSE, *({**CAUSE, "effect": name, "parameters": values, "stderr": {}} for name, values in OTHERS)]
    (tmp_path / "found.json").write_text(json.dumps({"verdict": "explained", "causes": causes, "terms": []}))
    return tmp_path


def export(cell, *words, found="found.json"):
    return main(["export", str(cell / found), "--format", "mjcf", *map(str, words)])


def test_a_diagnosis_becomes_a_scene_a_sensor_and_what_neither_says(cell, capsys):
    words = ("--setup", cell / "setup.toml", "--like", cell / "scene.xml", "-o", cell / "mended.xml")
    assert export(cell, *words) == 0
    model = mujoco.MjModel.from_xml_path(str(cell / "mended.xml"))
    np.testing.assert_allclose(model.body_subtreemass[model.body("hand").id], 0.9, rtol=1e-9)
    assert float(load_sensor_model(cell / "sensor_model.toml").values["low_pass"]["cutoff"]) == 9.0
    missing = json.loads((cell / "not_expressed.json").read_text())
    assert [one["effect"] for one in missing] == ["tool_flexibility"]
    assert "not expressed: tool_flexibility" in capsys.readouterr().out
    assert export(cell, *words) == 0, "files of ftbias are replaced"
    (cell / "not_expressed.json").write_text('["of somebody else"]')
    assert export(cell, *words) == 1
    assert "--force" in capsys.readouterr().err
    assert export(cell, *words, "--force") == 0


def test_a_setup_with_effects_is_exported_without_a_diagnosis(cell):
    text = (cell / "setup.toml").read_text()
    (cell / "fixed.toml").write_text(f"{text}[effects.gravity_tilt]\ngravity = [0.0, 0.5, -9.79]\n")
    assert export(cell, "--like", cell / "scene.xml", "-o", cell / "mended.xml", found="fixed.toml") == 0
    gravity = mujoco.MjModel.from_xml_path(str(cell / "mended.xml")).opt.gravity
    assert gravity[1] == pytest.approx(0.5, rel=0.01)


def test_a_urdf_is_mended_with_the_same_files_beside_it(tmp_path, capsys):
    (tmp_path / "arm.urdf").write_text(made_scenes.URDF)
    setup = '[robot]\nurdf = "arm.urdf"\ntip_link = "flange"\n[sensor]\nnoise_std = 0.1\n[tool]\n'
    (tmp_path / "setup.toml").write_text(f"{setup}from_urdf_link = 'hand'\n[effects.tool_mass]\nmass = 0.9\n")
    words = ("export", tmp_path / "setup.toml", "--format", "urdf", "--like", tmp_path / "arm.urdf")
    assert main([*map(str, words), "-o", str(tmp_path / "mended.urdf")]) == 0
    mended = made_scenes.URDF.replace('"0.7"', '"0.9"')
    text = f"{mended.rstrip()}\n<!-- mended by ftbias_jax {__version__} -->\n"
    assert (tmp_path / "mended.urdf").read_text() == text
    assert main([*map(str, words), "-o", str(tmp_path / "mended.urdf")]) == 0  # replaces its own files
    assert {"sensor_model.toml", "not_expressed.json"} < {path.name for path in tmp_path.iterdir()}


def test_the_sensor_alone(cell, capsys):
    words = ["export", str(cell / "found.json"), "--setup", str(cell / "setup.toml"), "--format", "sensor"]
    assert main(words) == 0
    assert "cutoff = 9.0" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (("--setup", "setup.toml", "-o", "mended.xml"), 2, "--like SCENE.xml"),
        (("--like", "scene.xml", "-o", "mended.xml"), 2, "--setup SETUP.toml"),
        (("--setup", "setup.toml", "--like", "scene.xml", "-o", "scene.xml"), 2, "same file"),
        (("--setup", "setup.toml", "--like", "scene.xml", "--site", "x", "-o", "mended.xml"), 1, "no site 'x'"),
    ],
)
def test_mistakes_end_in_one_line(cell, monkeypatch, capsys, words, code, message):
    monkeypatch.chdir(cell)
    assert export(cell, *words) == code
    printed = capsys.readouterr().err
    assert printed.count("\n") == 1
    assert message in printed
    assert (cell / "scene.xml").read_text() == made_scenes.SCENE


def test_a_file_that_is_no_diagnosis_is_refused(cell, capsys):
    (cell / "found.json").write_text('{"causes": [{"effect": "tool_mass"}]}')
    assert export(cell, "--setup", cell / "setup.toml", "--like", cell / "scene.xml", "-o", cell / "m.xml") == 1
    assert "is no diagnosis" in capsys.readouterr().err
