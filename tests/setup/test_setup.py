import copy
import dataclasses
import tomllib

import numpy as np
import one_line
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ftbias_jax.errors import SetupError
from ftbias_jax.setup import Setup, dump_setup, load_setup, parse_setup
from ftbias_jax.setup.rotations import rotation_from_rpy
from ftbias_jax.setup.types import DATA_NOISE_UNITS

FILE = "arm.toml"


def minimal():
    return {
        "robot": {"model": "panda"},
        "sensor": {"noise_std": [0.1, 0.004]},
        "tool": {"mass": 0.7, "center_of_mass": [0, 0, 0.06]},
    }


def screw_robot():
    return {
        "joints": [
            {"axis": [0, 0, 1], "point": [0, 0, 0.3]},
            {"axis": [0, 0.6, 0.8], "type": "prismatic", "name": "lift"},
        ],
        "flange": {"translation": [0, 0, 1.0], "rotation_rpy": [0.1, 0.2, 0.3]},
    }


def with_value(path, value):
    """The minimal setup with one value set at a dotted path."""
    tables = copy.deepcopy(minimal())
    *sections, key = path.split(".")
    table = tables
    for section in sections:
        table = table.setdefault(section, {})
    table[key] = value
    return tables


def fails(tables, *words):
    one_line.fails(lambda: parse_setup(tables, FILE), FILE, *words, kind=SetupError)


def assert_equal(a, b):
    """Check that two setups are equal: text and plain numbers exactly, screws and rotations to round-off."""
    for part in dataclasses.fields(Setup):
        left, right = getattr(a, part.name), getattr(b, part.name)
        if not dataclasses.is_dataclass(left):
            assert part.name in ("path", "source") or left == right
            continue
        for field in dataclasses.fields(left):
            x, y = getattr(left, field.name), getattr(right, field.name)
            if not isinstance(x, np.ndarray):
                assert x == y
            elif field.name in ("screws", "rotation", "flange_rotation"):
                np.testing.assert_allclose(x, y, rtol=0, atol=1e-14 * max(1, np.abs(x).max()))
            else:
                np.testing.assert_array_equal(x, y)


def test_every_array_is_float64_and_read_only():
    setup = parse_setup({**minimal(), "robot": screw_robot()})
    for part in (setup.robot, setup.sensor, setup.tool, setup.bias, setup.joints):
        for field in dataclasses.fields(part):
            value = getattr(part, field.name)
            if isinstance(value, np.ndarray):
                assert value.dtype == np.float64
                assert not value.flags.writeable, field.name


@pytest.mark.parametrize(
    ("path", "given", "expected"),
    [
        ("bias.noise_density", 2, [2] * 6),
        ("bias.noise_density", [1, 2], [1, 1, 1, 2, 2, 2]),
        ("bias.noise_density", [1, 2, 3, 4, 5, 6], [1, 2, 3, 4, 5, 6]),
        ("joints.position_noise_std", 1e-4, [1e-4] * 7),
        ("data_noise.linear_acceleration", 0.2, [0.2] * 3),
    ],
)
def test_one_number_or_a_pair_stands_for_all_axes(path, given, expected):
    section, key = path.split(".")
    np.testing.assert_array_equal(getattr(getattr(parse_setup(with_value(path, given)), section), key), expected)


@pytest.mark.parametrize("values", [{}, {"linear_acceleration": 0}, {"entries": [0] * 36}])
def test_no_noise_of_the_model_s_data_or_zeros_are_none(values):
    assert parse_setup({**minimal(), "data_noise": values}).data_noise is None


@pytest.mark.parametrize("key", ["correlated_std", "correlated_time"])
def test_correlated_noise_needs_both_its_size_and_its_time(key):
    fails(with_value(f"sensor.{key}", 0.3), f"sensor.{key}: stands alone", "correlated_std and correlated_time")


def test_noise_of_the_data_is_stated_by_its_entries_or_its_parts():
    fails({**minimal(), "data_noise": {"entries": [1] * 36, "angular_velocity": 1}}, "excluded by data_noise.entries")


def test_screw_robot():
    robot = parse_setup({**minimal(), "robot": screw_robot()}).robot
    np.testing.assert_array_equal(robot.screws, [[0, 0, 0, 0, 0, 1], [0, 0.6, 0.8, 0, 0, 0]])
    np.testing.assert_array_equal(robot.flange_rotation, rotation_from_rpy([0.1, 0.2, 0.3]))
    assert robot.joint_names == ("joint1", "lift")
    assert robot.model == "screws"


def test_rounded_axes_are_normalised_exactly():
    robot = screw_robot()
    robot["joints"][0]["axis"] = [0.81342, 0.3427, 0.47002]
    screws = parse_setup({**minimal(), "robot": robot}).robot.screws
    assert np.linalg.norm(screws[0, 3:]) == pytest.approx(1, abs=2e-16)


MISTAKES = [
    ("tol", {}, "tol: unknown key", "did you mean 'tool'?"),
    ("joints.zzz", 1.0, "joints.zzz", "known: initial_std, model"),
    ("log.topic", {}, "log.topic", "did you mean 'topics'?"),
    ("tool", 3, "tool: expected a table, got 3", "[tool]"),
    ("effects", [1], "effects: expected a table, got [1]", "[effects]"),
    ("effects.warmup", 3, "effects.warmup: expected a table", "[effects.warmup]"),
    ("tool.mass", True, "tool.mass: expected numbers, got True", "one number"),
    ("tool.mass", [0.7], "tool.mass: expected one number, got [0.7]", "without brackets"),
    ("tool.mass", 10**400, "tool.mass: got 1000", "greater than 0"),
    ("tool.mass", 1e300, "tool.mass: got 1e+300", "check the number and its unit"),
    ("tool.center_of_mass", [0, 0], "tool.center_of_mass: has 2 numbers", "give 3 numbers"),
    ("tool.center_of_mass", [[0, 0, 0]], "tool.center_of_mass: expected numbers", "give 3 numbers"),
    ("tool.inertia", [1e-3, 0, 0, 1e-3, 0, 3e-3], "tool.inertia", "principal moments 0.001, 0.001, 0.003 kg m^2"),
    ("tool.inertia", [-1e-3, 0, 0, 1e-3, 0, 1e-3], "tool.inertia", "sum of the others; all zeros = point mass"),
    ("tool.inertia", [-1e-3, 0, 0, -1e-3, 0, -1e-3], "tool.inertia", "sum of the others"),
    ("tool.inertia", [1e-3, 2e-3, 0, 1e-3, 0, 1e-3], "tool.inertia", "sum of the others"),
    (
        "sensor.noise_std",
        [0.1] * 3,
        "sensor.noise_std: has 3 numbers",
        "one number or two (force, torque) or 6 numbers",
    ),
    ("sensor.reports", "wrench_on_tol", "sensor.reports", "did you mean 'wrench_on_tool'?"),
    ("joints.model", "jerk", "joints.model: unknown value 'jerk'", "integrated_jerk"),
    ("joints.process_noise_density", [1, 2], "joints.process_noise_density: has 2 numbers", "one number or 7 numbers"),
    ("robot.model", "pandda", "robot.model: unknown value 'pandda'", "did you mean 'panda'?"),
    ("robot.gravity", [0, 0, -981], "robot.gravity: has length 981 m/s^2", "at most 30"),
    ("robot.urdf", "arm.urdf", "robot.model: excluded by robot.urdf", "remove one of the two"),
    ("robot.tip_link", "tool0", "robot.tip_link: belongs to robot.urdf", "remove it, or give robot.urdf"),
    ("tool.from_urdf_link", "hand", "tool.mass: excluded by tool.from_urdf_link", "remove one of the two"),
    ("robot.joints", [], "robot.joints: excluded by robot.model = 'panda'", "remove one of the two"),
    ("robot.flange", {}, "robot.flange: excluded by robot.model = 'panda'", "remove one of the two"),
    ("robot.joint_names", ["a"], "robot.joint_names: has 1 names", "give 7"),
    ("robot.joint_names", ["a"] * 7, "robot.joint_names: the name 'a' is there twice", "different names"),
    ("robot.joint_names", 7, "robot.joint_names: expected a list of strings, got 7", "give 7 names"),
    ("data_noise.entries", [1] * 35, "data_noise.entries: has 35 numbers", "give 36 numbers, each 0 or more"),
    ("log.columns.time", ["t"], "log.columns.time: expected a string", '"..."'),
]


@pytest.mark.parametrize(("path", "value", "what", "remedy"), MISTAKES, ids=[f"{m[0]}={m[1]!r:.20}" for m in MISTAKES])
def test_mistakes_are_named_with_their_remedy(path, value, what, remedy):
    fails(with_value(path, value), what, remedy)


@pytest.mark.parametrize(
    ("path", "remedy"),
    [
        ("robot", "add [robot]"),
        ("sensor", "add [sensor]"),
        ("robot.model", "give [[robot.joints]], robot.dh, or robot.model: panda, fr3"),
        ("sensor.noise_std", "give one number or two"),
    ],
)
def test_missing_keys_are_named(path, remedy):
    tables = minimal()
    *sections, key = path.split(".")
    del (tables[sections[0]] if sections else tables)[key]
    fails(tables, path.replace("robot.model", "robot.joints"), "missing", remedy)


@pytest.mark.parametrize(
    ("joint", "what", "remedy"),
    [
        ({"axis": [0, 0, 1]}, "robot.joints[1].point: missing key", "give 3 numbers"),
        ({"point": [0, 0, 1]}, "robot.joints[1].axis: missing key", "give 3 numbers"),
        ({"axis": [0, 0, 0.9], "point": [0, 0, 0]}, "robot.joints[1].axis: has length 0.9", "scale it to length 1"),
        ({"axis": [0, 0, 1], "type": "hinge"}, "robot.joints[1].type: unknown value 'hinge'", "prismatic, revolute"),
        ({"axis": [0, 0, 1], "points": 1}, "robot.joints[1].points: unknown key", "did you mean 'point'?"),
        (
            {"axis": [0, 0, 1], "point": [0, 0, 0], "name": "joint1"},
            "robot.joints[0].name: the name 'joint1'",
            "own name",
        ),
    ],
)
def test_mistakes_in_joints_are_named(joint, what, remedy):
    robot = screw_robot()
    robot["joints"][1] = joint
    fails({**minimal(), "robot": robot}, what, remedy)


@pytest.mark.parametrize(
    ("change", "what", "remedy"),
    [
        ({"joints": []}, "robot.joints: expected tables, got []", "one [[robot.joints]] per joint"),
        ({"joints": 3}, "robot.joints: expected tables, got 3", "one [[robot.joints]] per joint"),
        ({"joint_names": ["a", "b"]}, "robot.joint_names: belongs to robot.model", "name = ..."),
        ({"flange": {}}, "robot.flange.translation: missing key", "give 3 numbers"),
        ({"flange": None}, "robot.flange: missing section", "add [robot.flange]"),
    ],
)
def test_mistakes_in_screw_robots_are_named(change, what, remedy):
    robot = {key: value for key, value in {**screw_robot(), **change}.items() if value is not None}
    fails({**minimal(), "robot": robot}, what, remedy)


@pytest.mark.parametrize(
    "inertia", [[0.0] * 6, [1e-3, 0, 0, 1e-3, 0, 2e-3 * (1 + 4e-7)], [1e-3, 2e-4, 0, 2e-3, 0, 2e-3]]
)
def test_possible_inertias_pass(inertia):
    np.testing.assert_array_equal(parse_setup(with_value("tool.inertia", inertia)).tool.inertia, inertia)


@pytest.mark.parametrize(
    ("content", "what", "remedy"),
    [
        (b"[tool\nmass = 1", "is not valid TOML: Expected", "at line 1"),
        (b"a = " + b"[" * 100_000, "is not valid TOML", "correct the syntax"),
        (b'a = "\xff"', "is not valid TOML", "correct the syntax"),
        (b"#" * (1 << 20) + b"\n", "is larger than 1 MiB", "give a setup.toml, not a log"),
        (None, "cannot be read: No such file", "give the path of a setup.toml"),
    ],
    ids=["syntax", "nesting", "encoding", "size", "absent"],
)
def test_unreadable_files_are_named(tmp_path, content, what, remedy):
    path = tmp_path / FILE
    if content is not None:
        path.write_bytes(content)
    one_line.fails(lambda: load_setup(path), path, what, remedy, kind=SetupError)


def test_real_setups_load(shared_data):
    abb = load_setup(shared_data / "real" / "abb_frida.toml")
    assert abb.robot.screws.shape == (7, 6)
    assert abb.sensor.reports == "wrench_on_sensor"
    assert abb.path.endswith("abb_frida.toml")
    assert_equal(parse_setup(tomllib.loads(dump_setup(abb))), abb)


def test_a_built_in_robot_is_written_by_its_model_and_a_corrected_one_by_its_screws():
    setup = parse_setup(minimal())
    assert 'model = "panda"' in dump_setup(setup)
    assert "axis" not in dump_setup(setup)
    robot = dataclasses.replace(setup.robot, flange_translation=setup.robot.flange_translation + 0.001)
    again = parse_setup(tomllib.loads(dump_setup(dataclasses.replace(setup, robot=robot))))
    assert again.robot.model == "screws"
    np.testing.assert_array_equal(again.robot.flange_translation, robot.flange_translation)
    np.testing.assert_allclose(again.robot.screws, robot.screws, atol=1e-15)
    assert again.robot.joint_names == robot.joint_names


def test_units_and_comments_stand_behind_their_numbers():
    setup = parse_setup(with_value("data_noise.linear_acceleration", 0.2))
    lines = dump_setup(dataclasses.replace(setup, comments={"tool.mass": "fitted\nwas 0.73"})).splitlines()
    assert "mass = 0.7  # kg; fitted was 0.73" in lines
    assert "linear_acceleration = 0.2  # m/s^2, standard deviation" in lines


numbers = st.floats(-1e3, 1e3)
positive = st.floats(1e-9, 1e3)
angle = st.floats(-3, 3)
text = st.text(st.characters(codec="utf-8"), min_size=1, max_size=8)


def vectors(size, elements=numbers):
    return st.lists(elements, min_size=size, max_size=size)


@st.composite
def axes(draw):
    polar, around = draw(angle), draw(angle)
    return [float(np.sin(polar) * np.cos(around)), float(np.sin(polar) * np.sin(around)), float(np.cos(polar))]


joint = st.fixed_dictionaries({"axis": axes(), "point": vectors(3)}, optional={"type": st.just("prismatic")})
flange = st.fixed_dictionaries({"translation": vectors(3), "rotation_rpy": vectors(3, angle)})
parameter = st.recursive(
    st.booleans() | st.integers() | st.floats(allow_nan=False) | text | st.datetimes(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(text, inner, max_size=2),
    max_leaves=5,
)


@st.composite
def setups(draw):
    robot = draw(st.fixed_dictionaries({"joints": st.lists(joint, min_size=1, max_size=3), "flange": flange}))
    size = len(robot["joints"])
    for entry, name in zip(
        robot["joints"], draw(st.lists(text, min_size=size, max_size=size, unique=True)), strict=True
    ):
        entry["name"] = name
    robot = draw(st.sampled_from([robot, {"model": "fr3"}]))
    size = size if "joints" in robot else 7
    tables = {
        "robot": {**robot, "gravity": draw(vectors(3, st.floats(-15, 15)))},
        "sensor": {
            "translation": draw(vectors(3)),
            "rotation_rpy": draw(vectors(3, angle)),
            "noise_std": draw(vectors(6, positive)),
            "reports": draw(st.sampled_from(["wrench_on_tool", "wrench_on_sensor"])),
        },
        "tool": {"mass": draw(positive), "center_of_mass": draw(vectors(3)), "inertia": draw(inertias())},
        "bias": {"noise_density": draw(vectors(6, positive)), "initial": draw(vectors(6))},
        "joints": draw(
            st.fixed_dictionaries(
                {"position_noise_std": vectors(size, positive)},
                optional={"process_noise_density": vectors(size, positive)},
            )
        ),
        "data_noise": draw(
            st.one_of(
                st.fixed_dictionaries({}, optional=dict.fromkeys(DATA_NOISE_UNITS, vectors(3, positive))),
                st.fixed_dictionaries({"entries": vectors(36, positive)}),
            )
        ),
        "effects": draw(st.dictionaries(text, st.dictionaries(text, parameter, max_size=2), max_size=2)),
    }
    wrench_names = draw(st.lists(text, min_size=6, max_size=6, unique=True))
    return draw(st.sampled_from([tables, {**tables, "log": {"columns": {"time": "stamp", "wrench": wrench_names}}}]))


@st.composite
def inertias(draw):
    x, y, z = draw(vectors(3, st.floats(0, 1)))  # any second moments of mass make a body
    rotation = rotation_from_rpy(draw(vectors(3, angle)))
    inertia = rotation @ np.diag([y + z, x + z, x + y]) @ rotation.T
    return inertia[np.triu_indices(3)].tolist()


@given(setups())
def test_a_dumped_setup_reads_back_equal(tables):
    setup = parse_setup(tables)
    assert_equal(parse_setup(tomllib.loads(dump_setup(setup))), setup)
