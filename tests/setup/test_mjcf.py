import tomllib
from dataclasses import replace

import jax
import mujoco
import numpy as np
import pytest
from made_scenes import SCENE, TOML, reading_of_mujoco, write

from ftbias_jax.errors import SetupError
from ftbias_jax.model.effects.compose import predict
from ftbias_jax.model.effects.types import Model, Signals
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.setup import load_setup, parse_setup

JOINTS = tuple(f"joint{i}" for i in range(1, 8))


@pytest.fixture
def scene(tmp_path):
    return write(tmp_path)


def ours(setup, q, dq, ddq):
    """(T, 6) what the nominal model predicts."""
    params = params_from_setup(setup)
    t = np.arange(len(q)) / 100
    return jax.jit(predict)(Signals(t, q, dq, ddq, 0 * t, Model(params.arm, params.gravity, params.theta)), {})


def states(setup, count=20):
    return np.random.default_rng(0).uniform(-2, 2, (3, count, len(setup.robot.joint_names)))


def assert_close(value, expected, most=1e-9):
    assert np.linalg.norm(np.asarray(value) - expected) < most * np.linalg.norm(expected)


def test_the_wrench_of_the_tool_is_what_the_sensors_of_mujoco_read(scene):
    setup = load_setup(scene[1])
    assert setup.robot.joint_names == JOINTS
    motion = states(setup)
    model = mujoco.MjModel.from_xml_path(str(scene[0]))
    assert_close(ours(setup, *motion), reading_of_mujoco(model, JOINTS, *motion))


def test_mass_centre_and_inertia_are_those_of_mujoco_in_any_base_frame(scene):
    model = mujoco.MjModel.from_xml_path(str(scene[0]))
    for base in ("", 'base_link = "link2"\n'):
        scene[1].write_text(TOML.replace("[sensor]", f"{base}[sensor]"))
        setup = load_setup(scene[1])
        hand = model.body("hand").id
        np.testing.assert_allclose(setup.tool.mass, model.body_subtreemass[hand], rtol=1e-12)
        motion = states(setup)
        joints = setup.robot.joint_names
        assert joints == (JOINTS[2:] if base else JOINTS)
        assert_close(ours(setup, *motion), reading_of_mujoco(model, joints, *motion))


def test_a_setup_from_memory_knows_site_and_base_link(scene):
    stated = {"mjcf": str(scene[0]), "site": "ft_site", "base_link": "link2"}
    robot = parse_setup({"robot": stated, "sensor": {"noise_std": 0.1}}).robot
    assert (robot.site, robot.base_link) == ("ft_site", "link2")


def test_gravity_limits_and_the_tool_are_those_of_the_file_unless_the_setup_states_them(scene):
    scene[0].write_text(SCENE.replace("0 0 -9.81", "0 1 -9.7"))
    robot = load_setup(scene[1]).robot
    np.testing.assert_allclose(robot.gravity, [0, 1, -9.7])
    np.testing.assert_allclose(robot.position_limits[[0, 2]], [np.radians([-166, 166]), [-np.inf, np.inf]])
    stated = TOML.replace("[sensor]", "gravity = [0.0, 0.0, -1.6]\n[sensor]") + "[tool]\nmass = 2.0\n"
    setup = parse_setup(tomllib.loads(stated), str(scene[1]))
    np.testing.assert_array_equal(setup.robot.gravity, [0, 0, -1.6])
    assert setup.tool.mass == 2.0
    np.testing.assert_array_equal(setup.tool.center_of_mass, load_setup(scene[1]).tool.center_of_mass)


def test_a_sensor_beside_the_site_has_the_tool_in_its_own_frame(scene):
    moved = TOML.replace("[sensor]", "[sensor]\ntranslation = [0.0, 0.01, 0.02]\nrotation_rpy = [0.3, 0.1, -0.4]")
    at_site, beside = load_setup(scene[1]), parse_setup(tomllib.loads(moved), str(scene[1]))
    motion, rotation, arm = states(at_site), beside.sensor.rotation, beside.sensor.translation
    force, torque = np.split(np.asarray(ours(at_site, *motion)), 2, axis=1)
    expected = np.concatenate([force @ rotation, (torque - np.cross(arm, force)) @ rotation], 1)
    assert_close(ours(beside, *motion), expected)


def test_a_saved_setup_keeps_the_reference_and_states_what_was_changed(scene, tmp_path):
    setup = load_setup(scene[1])
    (tmp_path / "else").mkdir()
    replace(setup, tool=replace(setup.tool, mass=0.9)).save(tmp_path / "else" / "saved.toml")
    text = (tmp_path / "else" / "saved.toml").read_text()
    assert 'mjcf = "../scene.xml"' in text
    assert "screws" not in text
    saved = load_setup(tmp_path / "else" / "saved.toml")
    assert saved.tool.mass == 0.9
    np.testing.assert_array_equal(saved.tool.inertia, setup.tool.inertia)
    assert saved.files[1].endswith("scene.xml")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<mujoco model", "<!DOCTYPE mujoco [<!ENTITY a 'aaaa'>]><mujoco model", ["document type"]),
        ('site="ft_site"/>\n    <torque', 'site="other"/>\n    <torque', ["MuJoCo cannot compile it", "other"]),
        ("<freejoint/>", '<freejoint/><site name="s"/>', []),
        ('<torque name="torque" site="ft_site"/>', '<torque site="else"/>', ["2 sites", "else, ft_site"]),
        ("gripper.xml", "claw.xml", ["MuJoCo cannot compile it", "claw.xml"]),
        ('<joint name="joint1" range="-166 166"/>', '<joint name="joint1" type="ball"/>', ["'joint1'", "ball"]),
    ],
)
def test_mistakes_in_the_file_are_named(scene, old, new, words):
    text = SCENE.replace('<body name="base"', '<site name="else"/><body name="base"').replace(old, new, 1)
    scene[0].write_text(text)
    if not words:
        assert load_setup(scene[1]).robot.joint_names == JOINTS
        return
    with pytest.raises(SetupError, match=r"scene\.xml: ") as caught:
        load_setup(scene[1])
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('site = "ft_sit"', ["site", "no site 'ft_sit'", "did you mean 'ft_site'?"]),
        ('base_link = "finger"', ["base_link", "does not hang on 'finger'"]),
        ('tip_link = "hand"', ["robot.tip_link: excluded by robot.mjcf"]),
        ('joint_names = ["a"]', ["robot.joint_names", "give 7"]),
    ],
)
def test_what_the_setup_asks_for_must_be_there(scene, line, words):
    with pytest.raises(SetupError) as caught:
        parse_setup(tomllib.loads(TOML.replace("[sensor]", f"{line}\n[sensor]")), str(scene[1]))
    for word in words:
        assert word in str(caught.value)


def test_a_site_needs_an_mjcf_and_a_file_that_is_none_is_refused(tmp_path):
    with pytest.raises(SetupError, match=r"belongs to robot\.mjcf"):
        parse_setup({"robot": {"model": "panda", "site": "s"}, "sensor": {"noise_std": 0.1}})
    for content, words in ((b"<robot/>", "is no MJCF"), (b"\0", "is not valid XML"), (b"<a>" * 200, "nests more than")):
        (tmp_path / "scene.xml").write_bytes(content)
        with pytest.raises(SetupError, match=words):
            parse_setup(tomllib.loads(TOML), str(tmp_path / "setup.toml"))
