"""Tests generated from the table of keys: every key is checked with the parser and with the JSON Schema."""

import copy
import tomllib

import jsonschema
import numpy as np
import pytest

from ftbias_jax.errors import SetupError
from ftbias_jax.setup import dump_setup, parse_setup
from ftbias_jax.setup.dump import MEASURE, Known, write_template
from ftbias_jax.setup.fields import Section
from ftbias_jax.setup.keys.table import EFFECTS, PER_JOINT, SECTIONS, TOP, Kind, json_schema, key_of, read

ARM = {"joints": [{"axis": [0, 0, 1], "point": [0, 0, 0.3]}], "flange": {"translation": [0, 0, 1.0]}}
MINIMAL = {"robot": ARM, "sensor": {"noise_std": [0.1, 0.004]}, "tool": {"mass": 0.7, "center_of_mass": [0, 0, 0.06]}}
KEYS = [(section, key) for section, keys in SECTIONS.items() for key in keys.keys]
VALUES = [(section, key) for section, key in KEYS if key_of(f"{section}.{key}").kind not in (Kind.TABLE, Kind.TABLES)]
NUMERIC = [(section, key) for section, key in VALUES if key_of(f"{section}.{key}").kind in (Kind.NUMBER, Kind.NUMBERS)]
JOINTS = 1

# Keys that replace others, and the keys that they need beside them.
CONTEXT = {
    "robot.model": {"robot": {}},
    "robot.joint_names": {"robot": {"model": "panda"}},
    "robot.dh": {"robot": {"dh_convention": "standard"}},
    "robot.dh_convention": {"robot": {"dh": [[0, 1.5, 0.1, 0]]}},
    "robot.dh_units": {"robot": {"dh": [[0, 1.5, 0.1, 0]], "dh_convention": "standard"}},
    "sensor.correlated_std": {"sensor": {"noise_std": 0.1, "correlated_time": 0.2}},
    "sensor.correlated_time": {"sensor": {"noise_std": 0.1, "correlated_std": 0.2}},
    "data_noise.entries": {"data_noise": {}},
    "sensor_pose.acceleration_std": {"robot": {}, "sensor_pose": {"linear": "none"}},
    "sensor_pose.turns_about": {"robot": {}, "sensor_pose": {"linear": "none"}},
    "sensor_pose.base": {"robot": {}, "sensor_pose": {"frame": "tool0"}},
}
FILES = {"log": {"files": {"position": "*_joints.csv", "wrench": "*_wrench.csv"}}}
CONTEXT |= {f"log.files.{key}": FILES for key in SECTIONS["log.files"].keys}
OF_FILES = ("robot.urdf", "robot.mjcf", "robot.site", "robot.base_link", "robot.tip_link", "tool.from_urdf_link")
"""Keys that name a URDF or an MJCF, or something in it; tested in tests/setup/test_urdf.py and test_mjcf.py."""


def setup_for(name):
    tables = copy.deepcopy(MINIMAL)
    if name.startswith("sensor_pose."):
        tables |= {"robot": {}, "sensor_pose": {}}
    return tables | copy.deepcopy(CONTEXT.get(name, {}))


def with_value(section, key, value):
    tables = setup_for(f"{section}.{key}")
    table = tables
    for part in section.split("."):
        table = table.setdefault(part, {})
        table = table[0] if isinstance(table, list) else table
    table[key] = value
    return tables


def good_value(section, key):
    spec = key_of(f"{section}.{key}")
    if spec.kind is Kind.NAMES:
        count = spec.size or (7 if section == "robot" else JOINTS)
        return [f"name{i}" for i in range(count)]
    value = spec.default if spec.example is None else spec.example
    return (
        [list(row) for row in value] if spec.kind is Kind.ROWS else list(value) if isinstance(value, tuple) else value
    )


def parse(tables):
    """Parse tables as from a file, which has TOML's own types."""
    return parse_setup(tables, "setup.toml")


WRITTEN = [(section, key) for section, key in VALUES if section.split(".")[0] != "robot" and "noise_std" not in key]
"""Keys that are written back: arms are written as screws, and the noise of a pose in [joints]."""


def other_value(section, key):
    """A value other than the default."""
    spec = key_of(f"{section}.{key}")
    if spec.choices or spec.kind is Kind.FLAG:
        return spec.choices[-1] if spec.choices else not spec.default
    if spec.default is None or key == "inertia":
        return good_value(section, key)
    return 1.5 if spec.kind is Kind.NUMBER else [1.5] * (spec.size or JOINTS)


@pytest.mark.parametrize(("section", "key"), WRITTEN)
def test_every_key_with_another_value_than_its_default_is_written_and_comes_back(section, key):
    if f"{section}.{key}" in OF_FILES:
        pytest.skip("is replaced by what the URDF says")
    text = dump_setup(parse(with_value(section, key, other_value(section, key))))
    assert f"\n{key} = " in text
    assert dump_setup(parse(tomllib.loads(text))) == text


@pytest.mark.parametrize(("section", "key"), VALUES)
def test_every_default_is_what_holds_without_the_key(section, key):
    spec = key_of(f"{section}.{key}")
    if spec.default is None:
        assert spec.required or spec.absent or spec.kind is Kind.TEXT
        return
    size = JOINTS if spec.size == PER_JOINT else None
    value = list(spec.default) if isinstance(spec.default, tuple) else spec.default
    absent, stated = (read(Section(values, section, ""), key, size) for values in ({}, {key: value}))
    np.testing.assert_array_equal(absent, stated)


@pytest.mark.parametrize(("section", "key"), NUMERIC)
def test_every_number_refuses_what_is_out_of_its_range(section, key):
    spec = key_of(f"{section}.{key}")
    size = spec.size or JOINTS
    lowest = max(spec.least, spec.above)
    below = [] if np.isinf(lowest) else [lowest - 1]
    below += [] if np.isinf(spec.above) else [spec.above]
    for number in (*below, float("nan"), float("inf"), 1e31):
        value = number if spec.kind is Kind.NUMBER else [number] * size
        with pytest.raises(SetupError) as caught:
            read(Section({key: value}, section, "setup.toml"), key, size)
        assert caught.value.field == f"{section}.{key}"


@pytest.mark.parametrize("section", SECTIONS)
def test_a_misspelt_key_is_told_with_the_nearest_one_of_its_section(section):
    key = max(SECTIONS[section].keys, key=len)
    with pytest.raises(SetupError, match=f"did you mean '{key}'") as caught:
        parse(with_value(section, f"{key}x", 0))
    assert caught.value.message == "unknown key"


def test_a_section_that_is_not_in_the_table_is_refused():
    assert {*TOP} == {*(name.split(".")[0] for name in SECTIONS), EFFECTS}
    with pytest.raises(SetupError, match="did you mean 'joints'"):
        parse({**MINIMAL, "joint": {}})


@pytest.fixture(scope="module")
def validator():
    schema = json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@pytest.mark.parametrize(("section", "key"), VALUES)
def test_the_schema_agrees_with_the_parser_on_every_key(validator, section, key):
    spec = key_of(f"{section}.{key}")
    good = with_value(section, key, good_value(section, key))
    assert validator.is_valid(good)
    if f"{section}.{key}" not in OF_FILES:
        parse(good)
    assert not validator.is_valid(with_value(section, f"{key}x", 0))
    bad = 3 if spec.kind in (Kind.TEXT, Kind.FLAG, Kind.NAMES) else "three"
    assert not validator.is_valid(with_value(section, key, bad))
    with pytest.raises(SetupError) as caught:
        read(Section({key: bad}, section, "setup.toml"), key, JOINTS if spec.size == PER_JOINT else None)
    assert caught.value.field == f"{section}.{key}"
    assert caught.value.remedy
    if spec.choices:
        assert not validator.is_valid(with_value(section, key, "neither"))
    if spec.kind is Kind.NUMBERS and spec.size != PER_JOINT:
        assert not validator.is_valid(with_value(section, key, [1.0] * (spec.size + 1)))
        assert validator.is_valid(with_value(section, key, 1.0)) == spec.expand
    if spec.kind in (Kind.NUMBER, Kind.NUMBERS) and not np.isinf(max(spec.least, spec.above)):
        number = max(spec.least, spec.above) - 1
        value = number if spec.kind is Kind.NUMBER else [number] * (spec.size or JOINTS)
        assert not validator.is_valid(with_value(section, key, value))


def test_the_schema_wants_a_robot_or_a_pose_and_a_sensor(validator):
    assert validator.is_valid(MINIMAL)
    assert validator.is_valid({"sensor": MINIMAL["sensor"], "sensor_pose": {}})
    assert not validator.is_valid({"sensor": MINIMAL["sensor"]})
    assert not validator.is_valid({"robot": ARM})
    assert validator.is_valid({**MINIMAL, "effects": {"drag": {"coefficient": [1.0, 2.0]}}})


KNOWN = {"robot.model": Known("ur5e", "as asked"), "sensor.noise_std": Known([0.1, 0.004])}


def test_the_template_is_a_setup_that_says_what_to_measure():
    text = write_template(KNOWN, "First line\n\nSecond")
    assert text.startswith("# First line\n#\n# Second\n")
    assert 'model = "ur5e"  # as asked' in text
    assert f"# mass = 0.7  # kg; {MEASURE}" in text
    setup = parse(tomllib.loads(text))
    assert setup.tool.unknown == ("mass", "center_of_mass")
    assert setup.robot.model == "ur5e"


def test_every_line_that_the_template_comments_out_can_be_used_as_it_stands():
    excluded = {"base_link", "tip_link", "urdf", "joint_names", "from_urdf_link", "correlated_std", "correlated_time"}
    excluded |= {"dh_convention", "dh_units", "mjcf", "site"}
    lines = write_template(KNOWN).splitlines()
    places = [i for i, line in enumerate(lines) if line.startswith("# ") and " = " in line]
    names = [lines[i].removeprefix("# ").split(" = ")[0] for i in places]
    assert len(names) > 15
    for place, name in zip(places, names, strict=True):
        if name not in excluded:
            parse(tomllib.loads("\n".join([*lines[:place], lines[place].removeprefix("# "), *lines[place + 1 :]])))
