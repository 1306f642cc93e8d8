"""Exports against independent arithmetic: bodies as point masses, and the interpretation of each reader."""

import hashlib
import json
import re
from dataclasses import replace

import numpy as np
import pytest

import ftbias_jax as ft
from ftbias_jax.cli.commands.demo import SETUP as DEMO
from ftbias_jax.cli.main import main
from ftbias_jax.errors import OutputError, SetupError, UsageError
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.model.simulate_log import simulate
from ftbias_jax.setup import load_setup, parse_setup
from ftbias_jax.setup.export import FORMATS, export_text
from ftbias_jax.setup.export.payload import OF_TOOL, ExportOptions, with_effects_in_keys
from ftbias_jax.setup.rotations import rotation_from_rpy

SETUP = {
    "robot": {"model": "ur5e"},
    "sensor": {
        "translation": [0.01, -0.02, 0.04],
        "rotation_rpy": [0.3, -0.2, 0.7],
        "noise_std": [0.1, 0.004],
    },
    "tool": {
        "mass": 0.9,
        "center_of_mass": [0.01, -0.005, 0.06],
        "inertia": [2.5e-3, 1e-4, -2e-4, 2.2e-3, 3e-4, 1.1e-3],
    },
    "bias": {"initial": [1.5, -2.0, 0.25, 0.01, 0.0, -0.03]},
}
BIAS = np.array(SETUP["bias"]["initial"])


def setup_with(**sections):
    return parse_setup({name: {**SETUP.get(name, {}), **sections.get(name, {})} for name in {*SETUP, *sections}})


def turned(angles):
    """R = Rz(yaw) Ry(pitch) Rx(roll), written out."""
    (a, b, c), (s, t, u) = np.cos(angles), np.sin(angles)
    return np.array(
        [
            [c * b, c * t * s - u * a, c * t * a + u * s],
            [u * b, u * t * s + c * a, u * t * a - c * s],
            [-t, b * s, b * a],
        ]
    )


def masses_of(tool):
    """Point masses (6,) at places (6, 3) m in the sensor frame that have this mass, centre and inertia."""
    xx, xy, xz, yy, yz, zz = tool["inertia"]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    second = np.trace(inertia) / 2 * np.eye(3) - inertia  # integral of r r'
    spread, axes = np.linalg.eigh(second)
    arms = (axes * np.sqrt(3 * spread / tool["mass"])).T
    return np.full(6, tool["mass"] / 6), np.array(tool["center_of_mass"]) + np.concatenate([arms, -arms])


def moments(masses, places):
    """Mass, centre of mass, and inertia about it, by sums over points."""
    center = masses @ places / masses.sum()
    inertia = np.zeros((3, 3))
    for mass, (x, y, z) in zip(masses, places - center, strict=True):
        inertia += mass * np.array(
            [[y * y + z * z, -x * y, -x * z], [-x * y, x * x + z * z, -y * z], [-x * z, -y * z, x * x + y * y]]
        )
    return masses.sum(), center, inertia


def at_flange(more=()):
    """The tool's points, and others, in the flange frame of the setup, taken together."""
    masses, places = masses_of(SETUP["tool"])
    places = places @ turned(SETUP["sensor"]["rotation_rpy"]).T + SETUP["sensor"]["translation"]
    for mass, *place in more:
        masses, places = np.append(masses, mass), np.vstack([places, place])
    return moments(masses, places)


def ur_numbers(text):
    """Mass, centre and inertia (3, 3) as the controller interprets them."""
    (call,) = re.findall(r"^set_target_payload\((.*)\)$", text, re.MULTILINE)
    mass, cog, (xx, yy, zz, xy, xz, yz) = json.loads(f"[{call}]")
    return mass, np.array(cog), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@pytest.mark.parametrize("more", [(), ((0.3, 0.0, 0.01, 0.02),)])
def test_the_payload_of_ur_is_that_of_the_points_of_the_tool(more):
    options = ExportOptions(sensor_mass=more[0] if more else None)
    got = ur_numbers(export_text(setup_with(), "ur", options))
    for value, expected in zip(got, at_flange(more), strict=True):
        np.testing.assert_allclose(value, expected, rtol=1e-9, atol=1e-12)


def test_the_load_of_franka_has_the_inertia_column_by_column():
    said = json.loads(export_text(setup_with(robot={"model": "fr3_link8"}), "franka"))
    mass, center, inertia = at_flange()
    assert said["setLoad"]["mass"] == pytest.approx(mass)
    np.testing.assert_allclose(said["setLoad"]["F_x_Cload"], center)
    columns = [inertia[i, j] for j in range(3) for i in range(3)]
    np.testing.assert_allclose(said["setLoad"]["load_inertia"], columns, rtol=1e-9, atol=1e-12)
    request = said["franka_msgs/SetLoad"]
    assert (request["center_of_mass"], request["mass"]) == (said["setLoad"]["F_x_Cload"], said["setLoad"]["mass"])


@pytest.mark.parametrize("model", ["panda", "fr3"])
def test_the_frame_beyond_the_flange_is_taken_back_to_the_flange(model):
    """The frames differ by 107 mm along z; they are turned alike, or as the built-in robots state."""
    own = json.loads(export_text(setup_with(robot={"model": model}), "franka"))["setLoad"]
    its = json.loads(export_text(setup_with(robot={"model": f"{model}_link8"}), "franka"))["setLoad"]
    moved = np.subtract(own["F_x_Cload"], its["F_x_Cload"])
    assert moved[2] == pytest.approx(0.107)
    np.testing.assert_allclose(moved[:2], 0, atol=1e-12)
    np.testing.assert_allclose(own["load_inertia"], its["load_inertia"], atol=1e-12)


def reading(setup, rotation):
    """(6,) reading at rest: weight - bias for the wrench on the tool, by hand."""
    up = rotation.T @ -setup.robot.gravity  # of the base, in the sensor frame
    force = setup.tool.mass * up
    on_tool = np.concatenate([force, np.cross(setup.tool.center_of_mass, force)]) - setup.bias.initial
    return on_tool if setup.sensor.reports == "wrench_on_tool" else -on_tool


def loaded(text):
    """Loaded by the rules of YAML 1.1, as by PyYAML and ROS: a number with an exponent but no point is a string."""
    yaml = pytest.importorskip("ruamel.yaml").YAML(typ="safe", pure=True)
    yaml.version = (1, 1)
    return yaml.load(text.replace(" y:", ' "y":'))  # a boolean by the letter of YAML 1.1, but not for PyYAML


@pytest.mark.parametrize("reports", ["wrench_on_tool", "wrench_on_sensor"])
def test_what_ros2_control_publishes_with_it_is_zero_at_rest(reports):
    """The broadcaster adds its offset; the filter subtracts mass * gravity_field and CoG x that, as in its source."""
    setup = setup_with(sensor={"reports": reports}, robot={"gravity": [1.0, -2.0, -9.5]})
    parameters = loaded(export_text(setup, "ros"))["force_torque_sensor_broadcaster"]["ros__parameters"]
    step = parameters["sensor_filter_chain"]["filter1"]
    assert step["type"] == "control_filters/GravityCompensationWrench"
    assert (step["params"]["world_frame"], step["params"]["sensor_frame"]) == ("base", "ft_sensor")
    offset = [parameters["offset"][part][axis] for part in ("force", "torque") for axis in "xyz"]
    tool = step["params"]["tool"]
    for angles in ([0.0, 0.0, 0.0], [0.5, 1.0, -2.0]):
        rotation = turned(angles)
        force = rotation.T @ np.array(tool["gravity_field"]) * tool["mass"]
        left = reading(setup, rotation) + offset - np.concatenate([force, np.cross(tool["CoG"], force)])
        np.testing.assert_allclose(left, 0, atol=1e-9)


@pytest.mark.parametrize(("reports", "up"), [("wrench_on_tool", 1), ("wrench_on_sensor", -1)])
def test_what_gravity_compensation_publishes_with_ft_calib_is_zero_at_rest(reports, up):
    """compensated = reading - bias - mass * imu, with the sign of imu that the file requires."""
    setup = setup_with(sensor={"reports": reports})
    text = export_text(setup, "ft_calib", ExportOptions(sensor_frame="wrist"))
    assert ("9.81 m/s^2 up" in text) == (up == 1)
    said = loaded(text)
    assert (said["gripper_com_frame_id"], said["gripper_com_child_frame_id"]) == ("wrist", "gripper_com")
    assert said["gripper_com_pose"][3:] == [0, 0, 0]
    rotation = turned([0.5, 1.0, -2.0])
    force = said["gripper_mass"] * up * (rotation.T @ -setup.robot.gravity)
    weight = np.concatenate([force, np.cross(said["gripper_com_pose"][:3], force)])
    np.testing.assert_allclose(reading(setup, rotation) - said["bias"] - weight, 0, atol=1e-9)


@pytest.mark.parametrize(
    ("sections", "name", "words"),
    [
        ({"robot": {"model": "panda"}}, "ur", "robot.model: 'panda' is no robot of Universal Robots"),
        ({}, "franka", "robot.model: 'ur5e' is no robot of Franka"),
        ({"tool": {"mass": None}}, "ur", "tool.mass: is not stated"),
        ({"sensor": {"translation": None, "rotation_rpy": None}}, "ur", "sensor: the mounting of the sensor"),
        ({"sensor": {"compensated": "weight"}}, "ros", "sensor.compensated: 'weight': the reading has no weight"),
        ({"sensor": {"compensated": "tool"}}, "ft_calib", "sensor.compensated"),
    ],
)
def test_what_is_not_known_is_refused(sections, name, words):
    merged = {key: {**SETUP.get(key, {}), **sections.get(key, {})} for key in {*SETUP, *sections}}
    setup = parse_setup({key: {k: v for k, v in part.items() if v is not None} for key, part in merged.items()})
    with pytest.raises(SetupError, match=re.escape(words)):
        export_text(setup, name)


def test_small_numbers_are_numbers_to_every_reader():
    small = setup_with(tool={"center_of_mass": [1e-5, -2e-7, 0.06]}, bias={"initial": [1e-5, 0, 3, 0, 0, -4e-8]})
    said = loaded(export_text(small, "ft_calib"))
    np.testing.assert_allclose(said["gripper_com_pose"][:3], [1e-5, -2e-7, 0.06])
    np.testing.assert_allclose(said["bias"], [-1e-5, 0, -3, 0, 0, 4e-8])
    assert all(isinstance(x, float) for x in said["bias"])  # 3 without a point is an integer, which ROS 2 rejects
    for name in ("ur", "ros"):
        assert not re.search(
            r"\de[-+]?\d", "".join(line.partition("#")[0] for line in export_text(small, name).splitlines())
        )


def test_a_flange_that_nobody_vouches_for_is_refused():
    joints = [{"axis": [0, 0, 1], "point": [0, 0, 0]}]
    own = {**SETUP, "robot": {"joints": joints, "flange": {"translation": [0, 0, 1]}}}
    with pytest.raises(SetupError, match=r"robot.flange: the tool flange of Universal Robots is not known"):
        export_text(parse_setup(own), "ur")
    trusted = export_text(parse_setup(own), "ur", ExportOptions(frames_as_stated=True))
    assert ur_numbers(trusted)[0] == 0.9
    pose = {name: part for name, part in SETUP.items() if name != "robot"} | {"sensor_pose": {"linear": "none"}}
    with pytest.raises(SetupError, match=r"sensor_pose: a recorded pose has no flange"):
        export_text(parse_setup(pose), "ur")
    assert "mass: 0.9" in export_text(parse_setup(pose), "ros")


def test_a_mounting_of_zero_counts_if_it_is_written(tmp_path):
    (tmp_path / "setup.toml").write_text(
        """
robot.model = "ur5e"
sensor = {noise_std = 0.1, translation = [0, 0, 0]}
tool = {mass = 0.7, center_of_mass = [0, 0, 0.06]}
"""
    )
    text = export_text(load_setup(tmp_path / "setup.toml"), "ur")
    assert ur_numbers(text)[1].tolist() == [0, 0, 0.06]
    nowhere = setup_with(sensor={"translation": [0.0] * 3, "rotation_rpy": [0.0] * 3})
    assert "set_target_payload(0.9" in export_text(nowhere, "ur", ExportOptions(frames_as_stated=True))


def test_an_export_says_where_it_comes_from_and_what_it_leaves_out(tmp_path):
    setup_with().save(tmp_path / "setup.toml")
    setup = load_setup(tmp_path / "setup.toml")
    digest = hashlib.sha256((tmp_path / "setup.toml").read_bytes()).hexdigest()
    for name in ("ur", "ros", "ft_calib"):
        assert f"from setup.toml, sha256 {digest}" in export_text(setup, name)
    lagging = replace(setup, effects={"low_pass": {"cutoff": 6.0}}, comments={"tool.mass": "identified ± 0.01"})
    text = export_text(lagging, "ur")
    assert "# tool.mass: identified ± 0.01" in text
    assert "# not in these numbers: the effects of the setup (low_pass)" in text
    assert "the setup states no bias" in export_text(setup_with(bias={"initial": [0.0] * 6}), "ros")


def test_the_tool_that_effects_state_is_exported():
    """As ``diagnose --apply`` writes it: the payload of [tool] would be the wrong one."""
    values = {"mass": 1.2, "center_of_mass": [0.01, 0.0, 0.05], "inertia": [2e-3, 0.0, 0.0, 2e-3, 0.0, 1e-3]}
    effects = {effect: {key: values[key]} for effect, key in OF_TOOL.items()}
    for effect, key in OF_TOOL.items():
        assert [parameter.name for parameter in CATALOGUE[effect].parameters] == [key]
    for name in set(FORMATS) - {"franka"}:
        stated, found = (
            export_text(each, name) for each in (setup_with(tool=values), replace(setup_with(), effects=effects))
        )
        assert [line for line in found.splitlines() if not line.startswith("#")] == [
            line for line in stated.splitlines() if not line.startswith("#")
        ]


def test_effects_in_the_keys_of_the_setup_are_the_same_model():
    """With a sensor that is turned on the flange; what ``keep`` names stays an effect."""
    setup = parse_setup(DEMO)
    setup = replace(setup, sensor=replace(setup.sensor, rotation=rotation_from_rpy(np.array([0.3, -0.2, 1.1]))))
    effects = {"tool_mass": {"mass": 1.2}, "tool_inertia": {"inertia": [2e-3, 1e-4, 0.0, 3e-3, 0.0, 1e-3]}}
    effects |= {"mount_translation": {"translation": [0.01, -0.02, 0.04]}, "low_pass": {"cutoff": 20.0}}
    with_effects = replace(setup, effects=effects)
    in_keys = with_effects_in_keys(with_effects)
    assert set(in_keys.effects) == {"low_pass"}
    assert in_keys.tool.mass == 1.2
    assert with_effects_in_keys(with_effects, keep=effects) is with_effects
    log = simulate(with_effects, duration=5, rate=100, seed=2).log
    found, expected = (ft.filter_log(each, log) for each in (in_keys, with_effects))
    np.testing.assert_allclose(found.wrench_tool, expected.wrench_tool, atol=1e-4)  # single precision
    np.testing.assert_allclose(found.bias, expected.bias, atol=1e-4)


def test_the_command_and_the_method_write_the_same(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    setup_with().save("setup.toml")
    setup = load_setup("setup.toml")
    for name in set(FORMATS) - {"franka"}:
        assert main(["export", "setup.toml", "--format", name, "-o", f"{name}.txt"]) == 0
        setup.export("again.txt", name)
        written = (tmp_path / f"{name}.txt").read_text()
        assert written == (tmp_path / "again.txt").read_text()
        capsys.readouterr()
        assert main(["export", "setup.toml", "--format", name]) == 0
        assert capsys.readouterr().out == written
    more = ["--sensor-mass", "0.3", "0", "0.01", "0.02"]
    assert main(["export", "setup.toml", "--format", "ur", *more]) == 0
    assert ur_numbers(capsys.readouterr().out)[0] == pytest.approx(1.2)


def test_commands_that_cannot_be_carried_out_end_in_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    setup_with().save("setup.toml")
    for arguments, code, words in (
        (["--format", "ur"], 2, "SETUP.toml: needs a setup"),
        (["setup.toml", "--format", "ur", "-o", "setup.toml"], 2, "is the same file as the input"),
        (["setup.toml", "--format", "ur", "-o", "none/out"], 1, "the folder does not exist"),
        (["setup.toml", "--format", "ur", "--sensor-mass", "-1", "0", "0", "0"], 2, "is no mass"),
        (["setup.toml", "--format", "franka"], 1, "'ur5e' is no robot of Franka"),
    ):
        assert main(["export", *arguments]) == code
        printed = capsys.readouterr().err
        assert printed.count("\n") == 1
        assert words in printed
    with pytest.raises(UsageError, match="there is no format 'abb'"):
        setup_with().export("out", "abb")
    with pytest.raises(OutputError, match="cannot be written"):
        setup_with().export("none/out", "ur")
