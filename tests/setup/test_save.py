"""A setup that is read, changed and saved keeps its text except for the lines that changed."""

import difflib
import os
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ftbias_jax.setup import dump_setup, load_setup, parse_setup
from ftbias_jax.setup.dump import Known, write_template

TEXT = """# The robot of cell 3.
# Measured in May.

[tool]            # the new gripper
mass = 0.7        # kg, weighed on the kitchen scale
center_of_mass = [
    0.0,  # x
    0.0,
    0.06,
]

[robot]
model = "panda"   # ours

# The sensor was swapped once.
[sensor]
noise_std = [0.1, 0.004]
reports = "wrench_on_tool"   # the default, but I want to see it

[bias]
initial_std = 5.0

# Cable on the left side
[effects.tool_mass]
mass = 0.8  # ftbias diagnose: 0.8 \u00b1 0.1 kg
"""
ARM = """<robot name="one"><link name="base"/><link name="arm"/><link name="hand"><inertial><mass value="0.4"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint>
<joint name="hold" type="fixed"><parent link="arm"/><child link="hand"/></joint></robot>"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "setup.toml"
    path.write_text(TEXT)
    return path


def changed_lines(before, after):
    """Removed lines and added lines."""
    lines = list(difflib.ndiff(before.splitlines(), after.splitlines()))
    return [x[2:] for x in lines if x.startswith("- ")], [x[2:] for x in lines if x.startswith("+ ")]


def saved(setup, path):
    setup.save(path)
    return path.read_text()


def test_an_unchanged_setup_is_written_to_the_byte(file, tmp_path):
    assert saved(load_setup(file), tmp_path / "copy.toml") == TEXT


def test_only_the_lines_of_what_changed_differ(file, tmp_path):
    setup = load_setup(file)
    noise = np.array([0.2, 0.2, 0.2, 0.01, 0.01, 0.01])
    tuned = replace(
        setup,
        sensor=replace(setup.sensor, noise_std=noise),
        tool=replace(setup.tool, mass=0.75),
        comments={"sensor.noise_std": "tuned, relative standard errors 0.1", "tool.mass": "identified \u00b1 0.01"},
    )
    gone, come = changed_lines(TEXT, saved(tuned, tmp_path / "tuned.toml"))
    assert gone == ["mass = 0.7        # kg, weighed on the kitchen scale", "noise_std = [0.1, 0.004]"]
    assert come == [
        "mass = 0.75  # kg, weighed on the kitchen scale; identified \u00b1 0.01",
        "noise_std = [0.2, 0.2, 0.2, 0.01, 0.01, 0.01]  # N, Nm; tuned, relative standard errors 0.1",
    ]
    again = load_setup(tmp_path / "tuned.toml")
    np.testing.assert_array_equal(again.sensor.noise_std, noise)
    assert again.tool.mass == 0.75


def test_a_second_command_replaces_the_remark_of_the_first(file, tmp_path):
    setup = load_setup(file)
    for mass, error in ((0.75, 0.01), (0.76, 0.02)):
        remark = {"tool.mass": f"identified \u00b1 {error}"}
        setup = replace(setup, tool=replace(setup.tool, mass=mass), comments=remark)
        setup.save(tmp_path / "found.toml")
        setup = load_setup(tmp_path / "found.toml")
    text = (tmp_path / "found.toml").read_text()
    assert "mass = 0.76  # kg, weighed on the kitchen scale; identified \u00b1 0.02\n" in text


def test_new_keys_stand_at_the_end_of_their_section_and_new_sections_at_the_end(file, tmp_path):
    setup = load_setup(file)
    changed = replace(
        setup,
        bias=replace(setup.bias, noise_density=np.full(6, 1e-3)),
        effects={**setup.effects, "drag": {"coefficient": [1.0, 2.0, 3.0]}, "time delay": {}},
    )
    gone, come = changed_lines(TEXT, saved(changed, tmp_path / "new.toml"))
    assert gone == []
    assert come == [
        "noise_density = [0.001, 0.001, 0.001, 0.001, 0.001, 0.001]  # N/s^1.5, Nm/s^1.5",
        "",
        "[effects.drag]",
        "coefficient = [1.0, 2.0, 3.0]",
        "",
        '[effects."time delay"]',
    ]
    text = (tmp_path / "new.toml").read_text()
    assert text.index("noise_density") < text.index("# Cable on the left side")


def test_effects_are_replaced_on_their_lines_and_removed(file, tmp_path):
    setup = load_setup(file)
    other = replace(
        setup,
        effects={"tool_mass": {"mass": 0.9}},
        comments={"effects.tool_mass.mass": "ftbias diagnose: 0.9 \u00b1 0.2 kg"},
    )
    gone, come = changed_lines(TEXT, saved(other, tmp_path / "other.toml"))
    assert gone == ["mass = 0.8  # ftbias diagnose: 0.8 \u00b1 0.1 kg"]
    assert come == ["mass = 0.9  # ftbias diagnose: 0.9 \u00b1 0.2 kg"]


def test_every_term_has_a_section_of_its_own_and_the_text_before_them_stays(file, tmp_path):
    setup = load_setup(file)
    first = {"drive": "velocity", "form": "linear", "columns": [4, 9], "coefficients": [0.1, 0.2]}
    second = {"drive": "acceleration", "form": "swing", "frequency": 6.2, "coefficients": [0.9]}
    out = tmp_path / "out.toml"
    replace(setup, effects={**setup.effects, "term": [first, second]}).save(out)
    assert load_setup(out).effects["term"] == [first, second]
    assert out.read_text(encoding="utf-8").startswith(file.read_text(encoding="utf-8").rstrip())
    again = load_setup(out)
    replace(again, effects={**again.effects, "term": [second]}).save(out)
    assert load_setup(out).effects["term"] == [second]
    cleared = load_setup(out)
    replace(cleared, effects={name: x for name, x in cleared.effects.items() if name != "term"}).save(out)
    assert "term" not in load_setup(out).effects
    assert "term" not in out.read_text(encoding="utf-8")


def test_the_setup_of_a_urdf_keeps_the_reference_wherever_it_is_saved(tmp_path):
    (tmp_path / "arm.urdf").write_text(ARM)
    text = '[robot]\nurdf = "arm.urdf"  # from the driver\ntip_link = "arm"\n\n[sensor]\nnoise_std = 0.1\n'
    text += '\n[tool]\nfrom_urdf_link = "hand"\n'
    path = tmp_path / "setup.toml"
    path.write_text(text)
    setup = load_setup(path)
    tuned = replace(setup, sensor=replace(setup.sensor, noise_std=np.full(6, 0.2)))
    _, come = changed_lines(text, saved(tuned, tmp_path / "tuned.toml"))
    assert come == ["noise_std = [0.2, 0.2, 0.2, 0.2, 0.2, 0.2]"]
    (tmp_path / "results").mkdir()
    _, come = changed_lines(text, saved(setup, tmp_path / "results" / "tuned.toml"))
    assert come == [f'urdf = "{os.path.join("..", "arm.urdf")}"  # from the driver']
    identified = replace(setup, tool=replace(setup.tool, mass=0.5))
    gone, come = changed_lines(text, saved(identified, tmp_path / "found.toml"))
    assert gone == ['from_urdf_link = "hand"']
    assert [line.split(" = ")[0] for line in come] == ["mass", "center_of_mass", "inertia"]
    again = load_setup(tmp_path / "found.toml")
    assert again.tool.mass == 0.5
    np.testing.assert_allclose(again.tool.inertia, setup.tool.inertia)


def test_the_reminder_of_a_draft_goes_when_the_key_is_stated(tmp_path):
    path = tmp_path / "setup.toml"
    text = write_template({"robot.model": Known("ur5e"), "sensor.noise_std": Known([0.1, 0.004])})
    path.write_text(text)
    setup = load_setup(path)
    found = replace(setup, tool=replace(setup.tool, mass=0.9, center_of_mass=np.array([0.0, 0.0, 0.05])))
    gone, come = changed_lines(text, saved(found, tmp_path / "found.toml"))
    assert [line.split(" = ")[0] for line in gone] == ["# mass", "# center_of_mass"]
    assert come == ["mass = 0.9  # kg", "center_of_mass = [0.0, 0.0, 0.05]  # m, sensor frame"]


def test_another_arm_is_written_anew(file, tmp_path):
    setup = load_setup(file)
    screws = setup.robot.screws.copy()
    screws[0, 0] += 1e-3
    moved = replace(setup, robot=replace(setup.robot, screws=screws))
    assert saved(moved, tmp_path / "moved.toml") == dump_setup(moved)


def test_odd_ways_to_write_toml_keep_their_values(tmp_path):
    path = tmp_path / "odd.toml"
    path.write_text(
        'tool = { mass = 0.7, center_of_mass = [0, 0, 0.06] }\nrobot.model = "panda"\nsensor.noise_std = 0.1\r\n'
    )
    setup = load_setup(path)
    changed = replace(setup, tool=replace(setup.tool, mass=0.9), bias=replace(setup.bias, gate=5.0))
    changed.save(tmp_path / "even.toml")
    again = load_setup(tmp_path / "even.toml")
    assert again.tool.mass == 0.9
    assert again.bias.gate == 5.0


numbers = st.floats(1e-6, 1e6)


@settings(max_examples=20, deadline=None)
@given(mass=numbers, noise=numbers, gate=st.none() | st.floats(1, 100), adapt=st.booleans(), drag=st.none() | numbers)
def test_what_is_saved_is_what_is_read_again(tmp_path_factory, mass, noise, gate, adapt, drag):
    path = tmp_path_factory.getbasetemp() / "round_trip.toml"
    path.write_text(TEXT)
    setup = load_setup(path)
    changed = replace(
        setup,
        tool=replace(setup.tool, mass=mass),
        sensor=replace(setup.sensor, noise_std=np.full(6, noise)),
        bias=replace(setup.bias, gate=gate, adapt=adapt),
        effects={} if drag is None else {"drag": {"coefficient": drag}},
    )
    changed.save(path)
    assert dump_setup(load_setup(path)) == dump_setup(changed)
    assert "# The robot of cell 3." in path.read_text()
    assert dump_setup(parse_setup(tomllib.loads(path.read_text()))) == dump_setup(changed)
