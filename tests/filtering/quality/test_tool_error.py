"""Error bars that include the tool's uncertainty, against the derivatives of the wrench in poses at rest."""

from dataclasses import replace

import numpy as np
import pytest
from small_checks import TABLES

from ftbias_jax import filter_log, simulate
from ftbias_jax.check.motion import arm_motion, data_matrices
from ftbias_jax.check.regression import stated_tool
from ftbias_jax.filtering.quality.observability import error_of_tool, remark_of_model, with_error_of_model
from ftbias_jax.filtering.result import ARRAYS, Filtered
from ftbias_jax.setup import parse_setup

STEP = 1e-6


@pytest.fixture(scope="module")
def setup():
    tool = {**TABLES["tool"], "mass_std": 0.03, "center_of_mass_std": [0.001, 0.002, 0.004]}
    return parse_setup({**TABLES, "tool": tool})


@pytest.fixture(scope="module")
def wrench_of(setup):
    """Tool -> (8, 6) its wrench in eight poses at rest."""
    q = np.random.default_rng(0).uniform(-1, 1, (8, 6))
    motion = arm_motion(setup.robot, setup.sensor, q, 0 * q, 0 * q)
    columns = data_matrices(motion, setup.robot.gravity)
    return lambda tool: columns @ stated_tool(tool).theta


def test_it_is_what_the_standard_errors_make_of_the_weight(setup, wrench_of):
    tool = setup.tool
    moved = [(replace(tool, mass=tool.mass + STEP), tool.mass_std)]
    for axis, std in zip(np.eye(3), tool.center_of_mass_std, strict=True):
        moved.append((replace(tool, center_of_mass=tool.center_of_mass + STEP * axis), std))
    expected = sum(((wrench_of(other) - wrench_of(tool)) / STEP * std) ** 2 for other, std in moved)
    np.testing.assert_allclose(error_of_tool(wrench_of(tool), tool), np.sqrt(expected), rtol=1e-6, atol=1e-9)


def test_a_tool_that_is_known_leaves_the_error_bars_as_they_are(setup, wrench_of):
    known = replace(setup, tool=replace(setup.tool, mass_std=None, center_of_mass_std=None))
    filtered = Filtered(**{**dict.fromkeys(ARRAYS, np.ones((8, 6))), "wrench_tool": wrench_of(known.tool)})
    assert with_error_of_model(filtered, known) is filtered
    assert remark_of_model(known) == ()
    wide = with_error_of_model(filtered, setup)
    assert all((x > 1.001).any() for x in (wide.bias_std, wide.contact_wrench_std, wide.bias_smooth_std))
    assert wide.drift_smooth_std is filtered.drift_smooth_std
    assert "standard errors of 0.03 kg and 1 2 4 mm" in remark_of_model(setup)[0].what


def test_what_is_not_known_of_effects_is_in_the_error_bars(setup, wrench_of):
    known = replace(setup.tool, mass_std=None, center_of_mass_std=None)
    uncertain = replace(setup, tool=known, bias=replace(setup.bias, model_std=np.array([3, 0, 0, 0, 0, 4e-3])))
    filtered = Filtered(**{**dict.fromkeys(ARRAYS, np.full((8, 6), 4.0)), "wrench_tool": wrench_of(known)})
    wide = with_error_of_model(filtered, uncertain)
    np.testing.assert_allclose(wide.bias_std, np.hypot(4.0, np.tile([3, 0, 0, 0, 0, 4e-3], (8, 1))))
    assert "of the effects: standard errors of 3 0 0 0 0 0.004 N, Nm" in remark_of_model(uncertain)[0].what


def test_a_tool_that_was_changed_is_told_and_the_error_bars_of_the_bias_cover_it(setup):
    stated = replace(setup, tool=replace(setup.tool, mass_std=None, center_of_mass_std=None))
    heavier = {"tool_mass": {"mass": 1.25 * stated.tool.mass}}
    made, same = (simulate(stated, effects, duration=40.0, rate=100.0, seed=3) for effects in (heavier, None))
    changed, right = (filter_log(stated, one.log) for one in (made, same))
    assert changed.noise.tool_error == pytest.approx(0.25, abs=0.01)
    (told,) = [repair.what for repair in changed.repairs if "times what the setup's tool causes" in repair.what]
    assert "is 1.25 times" in told
    off = np.abs(changed.bias - made.truth.bias)[len(made.log.t) // 2 :]
    assert off.max() > 0.5
    assert (off < 3 * changed.bias_std[len(off) :]).mean() > 0.97
    assert right.noise.tool_error == 0
    assert (right.bias_std < changed.bias_std).all()
