"""What a term changes on average over its logs is left to the bias where the logs do not determine it."""

from dataclasses import replace

import numpy as np
import pytest
from made_states import still_state

from ftbias_jax.diagnosis.terms.constant import without_constant
from ftbias_jax.diagnosis.terms.grid import make_term
from ftbias_jax.model.effects.terms.columns import added
from ftbias_jax.model.effects.terms.parse import parse_terms, section_of

NOISE = np.repeat([0.1, 0.004], 3)
TIME = np.linspace(0, 30, 200)


def following(drive, form, angle, coefficients, spread):
    """(6,) mean and standard deviation of what a term adds, with its constant part as ``without_constant`` leaves it"""
    state = still_state(TIME, np.stack([np.sin(angle), 0 * angle, -np.cos(angle)], 1))
    state = state._replace(q=angle[:, None], position=angle[:, None] * np.ones(3))
    term = replace(make_term(drive, form, "sensor", "wrench", 1), coefficients=np.asarray(coefficients, float))
    one, stderr = without_constant(term, state, spread * np.eye(len(coefficients)), np.ones(len(coefficients)), NOISE)
    before, after = added(np, term, state), added(np, one, state)
    np.testing.assert_allclose(after - after.mean(0), before - before.mean(0), atol=1e-12)
    np.testing.assert_array_equal(added(np, parse_terms([section_of(one)])["1"], state), after)
    return before.mean(0), after.mean(0), stderr


@pytest.mark.parametrize("drive", ["joint_angle", "position"])
def test_a_cable_is_slack_somewhere_in_the_range_of_the_joint(drive):
    count = 6 if drive == "joint_angle" else 18
    angle = 1.5 + 0.2 * np.sin(TIME)
    before, after, _ = following(drive, "linear", angle, np.ones(count), 1e-6)
    assert np.abs(before).min() > 1
    np.testing.assert_allclose(after, 0, atol=1e-12)
    wide = 0.5 + 1.5 * np.sin(TIME)
    before, after, _ = following(drive, "linear", wide, np.ones(count), 1e-6)
    np.testing.assert_array_equal(after, before)


@pytest.mark.parametrize("sure", [True, False])
def test_a_mean_that_the_motion_does_not_determine_is_left_to_the_bias(sure):
    """Of a load, whose zero has a meaning, the mean is kept as long as it is certain."""
    state = still_state(TIME, np.tile([0.0, 0.0, -1.0], (len(TIME), 1)))
    state = state._replace(load=10 + np.sin(TIME)[:, None] * np.ones(6))
    term = replace(make_term("load", "square", "sensor", "wrench"), coefficients=np.full(6, 1e-3))
    spread = (1e-5 if sure else 1e-3) ** 2 * np.eye(6)
    one, stderr = without_constant(term, state, spread, np.ones(6), NOISE)
    assert np.any(one.offset) != sure
    assert (stderr < 0.02).all()


def test_what_goes_by_the_clock_begins_at_zero():
    state = still_state(TIME, np.tile([0.0, 0.0, -1.0], (len(TIME), 1)))
    term = replace(make_term("time", "linear", "sensor", "wrench"), coefficients=np.ones(6))
    one, _ = without_constant(term, state, 1e3 * np.eye(6), np.ones(6), NOISE)
    assert not np.any(one.offset)
