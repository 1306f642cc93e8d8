"""Setups of several tools on one robot."""

import copy

import pytest

from ftbias_jax.errors import SetupError
from ftbias_jax.setup import parse_setup
from ftbias_jax.setup.require import require_one_robot

FIRST = {
    "robot": {"model": "panda"},
    "sensor": {"noise_std": [0.1, 0.004]},
    "tool": {"mass": 0.7, "center_of_mass": [0, 0, 0.06]},
}


def changed(section, key, value):
    tables = copy.deepcopy(FIRST)
    tables.setdefault(section, {})[key] = value
    return parse_setup(tables, "other.toml")


@pytest.mark.parametrize(("section", "key", "value"), [("tool", "mass", 2.0), ("bias", "initial", [1.0, 0.1])])
def test_tool_and_prior_of_the_bias_may_differ(section, key, value):
    require_one_robot(parse_setup(FIRST, "first.toml"), changed(section, key, value))


@pytest.mark.parametrize(
    ("section", "key", "value", "words"),
    [
        ("sensor", "noise_std", 0.2, "sensor.noise_std: [0.2, 0.2, 0.2, 0.2, 0.2, 0.2] differs from [0.1, 0.1, 0.1"),
        ("bias", "noise_density", 1.0, "bias.noise_density: [1.0"),
        ("robot", "gravity", [0.0, 0.0, -9.8], "robot.gravity: [0.0, 0.0, -9.8] differs"),
        (
            "joints",
            "model",
            "acceleration",
            "joints.model: 'acceleration' differs from 'integrated_jerk' in first",
        ),
        ("data_noise", "linear_acceleration", 1.0, "data_noise: "),
        ("effects", "gain", {"fx": 1.1}, "effects: {'gain'"),
    ],
)
def test_anything_else_is_named(section, key, value, words):
    with pytest.raises(SetupError) as caught:
        require_one_robot(parse_setup(FIRST, "first.toml"), changed(section, key, value))
    assert str(caught.value).startswith(f"other.toml: {words}")
    assert "[tool]" in caught.value.remedy
