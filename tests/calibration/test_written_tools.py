"""What identify writes: never a guess, never an impossible tool, and always a setup that every command reads."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import ftbias_jax as ft
from ftbias_jax.calibration import identify_tool
from ftbias_jax.cli.commands import demo
from ftbias_jax.errors import SetupError
from ftbias_jax.setup import load_setup, parse_setup
from ftbias_jax.setup.require import guessed_parameters
from ftbias_jax.setup.rotations import rotation_from_rpy
from ftbias_jax.setup.types import ToolSetup, unknown_tool

SETUP = parse_setup(demo.SETUP)
STATED = SETUP.tool
WRONG = np.deg2rad([1.5, 0.0, 0.0])
NO_CENTER = replace(STATED, center_of_mass=np.full(3, np.nan))


@pytest.mark.parametrize(
    ("given", "open_", "guessed"),
    [
        (STATED, (0, 1, 2, 3), ()),
        (unknown_tool(), (4, 5, 6, 7, 8, 9), ()),
        (unknown_tool(), (0,), (0, 1, 2, 3)),
        (unknown_tool(), (2,), (1, 2, 3)),
        (NO_CENTER, (0,), ()),
        (NO_CENTER, (0, 3), (1, 2, 3)),
    ],
)
def test_what_was_neither_stated_nor_found_is_a_guess(given, open_, guessed):
    flags = guessed_parameters(given, ["kept" if i in open_ else "" for i in range(10)])
    assert tuple(np.flatnonzero(flags)) == guessed
    assert len(flags) in (0, 10)


@pytest.mark.parametrize(
    "tool",
    [
        replace(STATED, mass=-0.137),
        replace(STATED, mass=0.0),
        replace(STATED, inertia=np.array([1.0, 0, 0, 1.0, 0, 3.0])),
        replace(STATED, inertia=np.array([-1.0, 0, 0, 1.0, 0, 1.0])),
    ],
)
@pytest.mark.parametrize("source", ["", "as read"])
def test_a_tool_that_no_body_can_have_is_not_written(tmp_path, tool, source):
    SETUP.save(tmp_path / "old.toml")
    setup = load_setup(tmp_path / "old.toml") if source else SETUP
    with pytest.raises(SetupError, match=r"no command could read it|tool"):
        replace(setup, tool=tool).save(tmp_path / "new.toml")
    assert [path.name for path in tmp_path.iterdir()] == ["old.toml"]


@pytest.mark.parametrize("noise", [6.55e-20, -3e-18, 1e-13])
def test_the_round_off_of_a_point_mass_is_read_again(tmp_path, noise):
    point = ToolSetup(0.7, np.array([0, 0, 0.05]), np.array([0, 0, 0, 0, 0, noise]))
    replace(SETUP, tool=point).save(tmp_path / "new.toml", by="identify")
    assert load_setup(tmp_path / "new.toml", with_tool=True).tool.mass == 0.7


def test_a_drafted_setup_gets_the_place_of_its_sensor_and_standard_errors():
    """A drafted setup has the sensor at the flange: without its place, the mass would be 0.5 % low, and sure of it."""
    right = replace(SETUP, sensor=replace(SETUP.sensor, translation=np.array([0.0, 0.0, 0.035])))
    log = ft.simulate(right, duration=15, rate=200, seed=3).log
    draft = replace(right, sensor=replace(right.sensor, translation=np.zeros(3)), tool=unknown_tool())
    result = ft.identify_tool(draft, log, unchecked=True)
    found, stderr = result.setup, result.tool.lever_stderr
    assert (np.abs(found.sensor.translation - [0, 0, 0.035]) < 4 * stderr).all()
    assert stderr.max() < 6e-3
    assert abs(found.tool.mass - right.tool.mass) < 4 * found.tool.mass_std
    assert (np.abs(found.tool.center_of_mass - right.tool.center_of_mass) < 4 * found.tool.center_of_mass_std).all()
    assert (found.bias.model_std > 0).all()
    assert found.comments["sensor.translation"].startswith("identified")


def test_a_value_that_is_kept_keeps_the_comment_on_its_origin():
    """As in a second step of calibrate, which starts from the inertia that the first one identified."""
    found = SimpleNamespace(stderr=np.full(10, np.nan), remarks=("kept",) * 10, has_lever=False)
    setup = replace(SETUP, comments={"tool.inertia": "identified"})
    assert identify_tool._comments(setup, found, False, False, False).keys() == {"tool.mass", "tool.center_of_mass"}


def test_it_is_said_when_parts_of_a_log_disagree():
    """A sensor turned by 1.5 degrees moves the centre of mass by many of its errors; nothing remains that is large."""
    turned = replace(SETUP, sensor=replace(SETUP.sensor, rotation=SETUP.sensor.rotation @ rotation_from_rpy(WRONG)))
    log = ft.simulate(SETUP, duration=15, rate=200, seed=3).log
    right, wrong = ft.identify_tool(SETUP, log), ft.identify_tool(turned, log, unchecked=True)
    assert right.tool.dispersion < 2 < 6.25 < wrong.tool.dispersion
    assert wrong.tool.excess < 5
    assert "parts of the log disagree" in str(wrong)
    assert "disagree" not in str(right)
