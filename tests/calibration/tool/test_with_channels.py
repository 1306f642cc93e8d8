"""Gains and crosstalk in a setup: added to those it has, readable again, and none where a log shows none."""

from dataclasses import replace

import numpy as np
import pytest

import ftbias_jax as ft
from ftbias_jax.calibration.tool.channels import UNITS, Channels, channels_in_words, with_channels
from ftbias_jax.cli.commands import demo
from ftbias_jax.setup import parse_setup

SETUP = parse_setup(demo.SETUP)
MATRIX = np.eye(6) + 0.03 * UNITS * np.random.default_rng(0).normal(size=(6, 6))


def found(held_out=(40.0, 8.0)):
    return Channels(MATRIX, 0.01 * UNITS, 30.0, held_out)


def read_through(setup, wrench):
    """Reading (6,) of a wrench (6,): gains first, then crosstalk, as in the catalogue."""
    gain = np.broadcast_to(setup.effects["gain"]["gain"], 6)
    return np.array(setup.effects["crosstalk"]["matrix"]) @ (gain * wrench)


def test_the_effects_written_read_as_the_matrix_does(tmp_path):
    with_channels(SETUP, found()).save(tmp_path / "found.toml")
    written = ft.load_setup(tmp_path / "found.toml")
    wrench = np.array([3.0, -2.0, 9.0, 0.2, 0.4, -0.1])
    np.testing.assert_allclose(read_through(written, wrench), MATRIX @ wrench)
    assert "identified ±" in (tmp_path / "found.toml").read_text(encoding="utf-8")


def test_what_is_found_comes_after_what_the_setup_states():
    leak = np.eye(6)
    leak[0, 1] = 0.2
    stated = replace(SETUP, effects={"gain": {"gain": [1.1, 0.9]}, "crosstalk": {"matrix": leak}})
    wrench = np.array([3.0, -2.0, 9.0, 0.2, 0.4, -0.1])
    before = leak @ (np.repeat([1.1, 0.9], 3) * wrench)
    np.testing.assert_allclose(read_through(with_channels(stated, found()), wrench), MATRIX @ before)


@pytest.mark.parametrize("held_out", [(40.0, 20.0), (-5.0, 1.0)])
def test_what_blocks_left_out_do_not_show_is_not_written(held_out):
    assert with_channels(SETUP, found(held_out)) is SETUP
    (line,) = channels_in_words(found(held_out))
    assert "not shown by this log" in line


def test_the_table_has_what_each_channel_reads_of_a_tenth_of_a_newton_metre():
    lines = channels_in_words(found())
    assert "40 ± 8 nats" in lines[0]
    assert lines[-6].split() == ["fx", *(f"{x:.3f}" for x in MATRIX[0] * np.repeat([1, 0.1], 3))]


def test_poses_at_rest_are_refused():
    poses = ft.Poses.from_arrays(SETUP, np.zeros((4, 6)), np.zeros((4, 7)))
    with pytest.raises(ft.UsageError, match="not found from static poses"):
        ft.identify_tool(SETUP, poses, crosstalk=True)
