import difflib
from dataclasses import replace

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from made_scenes import GRIPPER, SCENE, reading_of_mujoco, write

from ftbias_jax.errors import SetupError
from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.catalogue import CATALOGUE, complete, values_from_setup
from ftbias_jax.model.effects.types import Model, Signals
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.setup import load_setup
from ftbias_jax.setup.mjcf import load_mjcf
from ftbias_jax.simulators.mend_mjcf import mend_mjcf
from ftbias_jax.simulators.replay import replay

EFFECTS = {
    "tool_mass": {"mass": 0.9},
    "tool_com": {"center_of_mass": [0.02, 0.01, 0.05]},
    "tool_inertia": {"inertia": [0.003, 1e-4, 0.0, 0.0025, 2e-4, 0.002]},
    "gravity_tilt": {"gravity": [0.1, -0.2, -9.8]},
    "mount_translation": {"translation": [0.003, -0.002, 0.005]},
    "mount_rotation": {"rotation": [0.02, -0.03, 0.05]},
    "encoder_offset": {"joint": 4, "offset": 0.03},
    "cable": {"stiffness": 20.0, "rest_length": 0.1, "anchor": [0.3, 0.1, 0.9], "attachment": [0.0, 0.0, 0.05]},
}


@pytest.fixture
def scene(tmp_path):
    return write(tmp_path)


def mended(setup, scene, output):
    made = mend_mjcf(setup, load_mjcf(scene), str(output))
    for path, text in made.files.items():
        with open(path, "w") as file:
            file.write(text)
    return made


def states(n=7, count=10):
    return np.random.default_rng(0).uniform(-1.5, 1.5, (3, count, n))


def expected_of(setup, q, dq, ddq, t=None):
    """(T, 6) prediction of the package's model with the setup's effects."""
    params, zero = params_from_setup(setup), jnp.zeros(len(q))
    model = Model(params.arm, params.gravity, params.theta)
    signals = Signals(zero if t is None else t, jnp.asarray(q), dq, ddq, zero, model)
    values = {name: jax.tree.map(jnp.asarray, x) for name, x in values_from_setup(setup.effects).items()}
    values |= {name: complete(CATALOGUE[name], x, model) for name, x in values.items() if name in CATALOGUE}
    return compose.predict(signals, values)


def changed_lines(before, after):
    return [line for line in difflib.ndiff(before.splitlines(), after.splitlines()) if line[0] in "+-"]


@pytest.mark.parametrize("names", [*((name,) for name in EFFECTS), tuple(EFFECTS)], ids=lambda names: names[0][:12])
def test_mujoco_reads_of_the_mended_file_what_the_model_with_the_effects_predicts(scene, names, tmp_path):
    setup = replace(load_setup(scene[1]), effects={name: EFFECTS[name] for name in names})
    made = mended(setup, scene[0], tmp_path / "mended.xml")
    assert made.not_expressed == []
    motion = states()
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "mended.xml"))
    reading = reading_of_mujoco(model, setup.robot.joint_names, *motion)
    expected = np.asarray(expected_of(setup, *motion))
    assert np.abs(reading - expected).max() < 1e-6 * np.abs(expected).max()


def test_a_setup_without_effects_leaves_the_file_as_it_is_to_the_byte(scene, tmp_path):
    made = mend_mjcf(load_setup(scene[1]), load_mjcf(scene[0]), str(tmp_path / "mended.xml"))
    assert list(made.files.values()) == [SCENE]


def test_only_the_lines_that_must_differ_do(scene, tmp_path):
    setup = replace(load_setup(scene[1]), effects={"encoder_offset": EFFECTS["encoder_offset"]})
    made = mended(setup, scene[0], tmp_path / "mended.xml")
    old, new = changed_lines(SCENE, made.files[str(tmp_path / "mended.xml")])[:2]
    assert 'ref="-90"' in old
    ref = float(new.partition('ref="')[2].partition('"')[0])
    assert ref == pytest.approx(-90 + np.degrees(0.03))
    setup = replace(setup, effects={"gravity_tilt": EFFECTS["gravity_tilt"]})
    text = mended(setup, scene[0], tmp_path / "mended.xml").files[str(tmp_path / "mended.xml")]
    assert {line[0] for line in changed_lines(SCENE, text)} == {"+", "-"}
    assert len(changed_lines(SCENE, text)) == 2
    assert "<!-- as everywhere -->" in text


def test_an_inertial_that_is_there_changes_only_where_it_must(scene, tmp_path):
    stated = '<inertial pos="0 0 0.03" mass="0.6" diaginertia="0.002 0.002 0.001"/>'
    text = SCENE.replace("<!-- the sensor -->", stated)
    scene[0].write_text(text.replace('<include file="gripper.xml"/>', ""))
    setup = replace(load_setup(scene[1]), effects={"tool_mass": {"mass": 0.9}})
    made = mended(setup, scene[0], tmp_path / "mended.xml").files[str(tmp_path / "mended.xml")]
    assert 'pos="0 0 0.03" mass="0.9" diaginertia="0.002 0.002 0.001"' in made


def test_the_heaviest_body_takes_the_difference_also_in_an_included_file_and_from_another_folder(scene, tmp_path):
    heavy = GRIPPER.replace(
        "<mujocoinclude>", '<mujocoinclude><body name="block" pos="0 0 0.1"><geom size="0.05 0.05"/></body>'
    )
    (tmp_path / "gripper.xml").write_text(heavy)
    setup = replace(load_setup(scene[1]), effects={"tool_mass": {"mass": 2.5}})
    (tmp_path / "out").mkdir()
    made = mended(setup, scene[0], tmp_path / "out" / "mended.xml")
    assert [path.rpartition("/")[2] for path in made.files] == ["mended.xml", "mended_gripper.xml"]
    assert '<include file="mended_gripper.xml"/>' in changed_lines(SCENE, next(iter(made.files.values())))[1]
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "mended.xml"))
    assert model.body_subtreemass[model.body("hand").id] == pytest.approx(2.5)
    setup = replace(setup, effects={"gravity_tilt": EFFECTS["gravity_tilt"]})
    made = mended(setup, scene[0], tmp_path / "out" / "other.xml")
    assert 'file="../gripper.xml"' in next(iter(made.files.values()))
    mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "other.xml"))


def test_what_the_file_cannot_say_is_listed_with_the_reason(scene, tmp_path):
    balanced = {"frequency": 9.0, "damping_ratio": 0.1, "sagging": 0.0}
    effects = {"tool_flexibility": balanced, "low_pass": {"cutoff": 9.0}}
    setup = replace(load_setup(scene[1]), effects=effects)
    made = mend_mjcf(setup, load_mjcf(scene[0]), str(tmp_path / "mended.xml"))
    assert [(x["effect"], x["parameters"]) for x in made.not_expressed] == [
        ("tool_flexibility", effects["tool_flexibility"])
    ]
    assert "balanced" in made.not_expressed[0]["why"]
    scene[0].write_text(SCENE.replace("<compiler ", '<compiler inertiafromgeom="true" '))
    setup = replace(setup, effects={"tool_mass": {"mass": 0.9}})
    made = mend_mjcf(setup, load_mjcf(scene[0]), str(tmp_path / "mended.xml"))
    assert made.not_expressed[0]["effect"] == "tool"
    assert "inertiafromgeom" in made.not_expressed[0]["why"]
    setup = replace(setup, effects={"tool_mass": {"mass": 0.01}})
    scene[0].write_text(SCENE)
    assert "would be no body" in mend_mjcf(setup, load_mjcf(scene[0]), "mended.xml").not_expressed[0]["why"]


DRAG = {"drive": "velocity", "form": "linear", "frame": "base", "acts_as": "force", "point": [0.0, 0.02, 0.05]}


def slow_motion(n=7):
    """t, and (T, n, 3) joint states that begin at rest."""
    t = np.arange(2000) * 0.005
    size, phase = 0.5 + 0.1 * np.arange(n), 0.3 * np.arange(n)
    ramp, speed = 1 - np.exp(-(t**2) / 4), 0.6
    q = size * ramp[:, None] * np.sin(speed * t[:, None] + phase)
    dq = np.gradient(q, t, axis=0)
    return t, np.stack([q, dq, np.gradient(dq, t, axis=0)], 2)


@pytest.mark.parametrize("share", [[0.4, 0.4, 0, 0, 0, 0], [0, 0, 0, 0.4, 0.2, 0]], ids=["shifts", "turns"])
def test_a_part_on_springs_sags_in_mujoco_as_in_the_model(scene, share, tmp_path):
    free = SCENE.replace('density="800"', 'density="800" contype="0" conaffinity="0"')
    scene[0].write_text(free.replace("</worldbody>", f"</worldbody><keyframe><key qpos='{'0 ' * 15}'/></keyframe>"))
    flexibility = {"frequency": 9.0, "damping_ratio": 0.05, "share": share}
    setup = load_setup(scene[1])
    made = mended(replace(setup, effects={"tool_flexibility": flexibility}), scene[0], tmp_path / "mended.xml")
    assert made.not_expressed == []
    t, states = slow_motion()
    felt = replay(load_mjcf(tmp_path / "mended.xml"), t, states) - replay(load_mjcf(scene[0]), t, states)
    rigid, sagged = (
        expected_of(replace(setup, effects=effects), *np.moveaxis(states, 2, 0), t=t)
        for effects in ({}, {"tool_flexibility": flexibility})
    )
    expected = (sagged - rigid)[200:, 3:5]
    assert np.abs(felt[200:, 3:5] - expected).max() < 0.2 * np.abs(expected).max()


def test_drag_is_dampers_that_the_sensor_feels_as_the_model_says(scene, tmp_path):
    terms = [{**DRAG, "coefficients": [9.0]}, {**DRAG, "frame": "sensor", "coefficients": [9.0, 8.0, 7.0]}]
    setup = replace(load_setup(scene[1]), effects={"term": terms})
    made = mended(setup, scene[0], tmp_path / "mended.xml")
    assert [x["parameters"] for x in made.not_expressed] == [terms[1:]]
    t, states = slow_motion()
    felt = replay(load_mjcf(tmp_path / "mended.xml"), t, states) - replay(load_mjcf(scene[0]), t, states)
    setup = replace(setup, effects={"term": terms[:1]})
    motion = np.moveaxis(states, 2, 0)
    expected = expected_of(setup, *motion, t=t) - expected_of(replace(setup, effects={}), *motion, t=t)
    assert np.abs(expected[:, :3]).max() > 1
    assert np.abs(felt - expected).max() < 3e-3 * np.abs(expected).max()


def test_a_scene_with_another_arm_is_refused(scene):
    setup = load_setup(scene[1])
    scene[0].write_text(SCENE.replace('pos="0 0 0.33"', 'pos="0 0 0.3"'))
    with pytest.raises(SetupError, match="its arm is not the one of the setup"):
        mend_mjcf(setup, load_mjcf(scene[0]), "mended.xml")
