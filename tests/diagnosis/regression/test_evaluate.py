"""Readings and derivatives with the arm's motion computed separately equal those computed in one pass."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.diagnosis.problem import Part, Problem
from ftbias_jax.diagnosis.regression.chain_model import nominal_motion, to_values
from ftbias_jax.diagnosis.regression.coordinates import layout
from ftbias_jax.diagnosis.regression.evaluate import readings, slopes
from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.types import Model, Signals


@pytest.fixture(scope="module")
def problem(params):
    """Half a second of a small arm whose setup states a gain and an encoder offset; the last 10 samples are padding."""
    t = np.arange(60) / 100
    angle = 4 * t[:, None] + np.arange(3)
    signals = Signals(
        t, np.sin(angle), 4 * np.cos(angle), -16 * np.sin(angle), 0 * t, Model(params.arm, params.gravity, params.theta)
    )
    known = {"gain": {"gain": np.full(6, 1.1)}, "encoder_offset": {"joint": np.array(2.0), "offset": np.array(0.03)}}
    nothing = np.zeros(50)
    signals = jax.tree.map(jnp.asarray, signals)
    part = Part(signals, None, 50, nominal_motion(signals, known), None)
    return Problem((part,), t[:50], nothing, nothing, nothing, nothing, (0.5,), np.ones(6), known)


@pytest.fixture(scope="module")
def direct(problem):
    """(P,) coordinates -> (50, 6) reading."""
    signals = problem.parts[0].signals

    @jax.jit
    def reading(z):
        values, stated = to_values(signals, z), problem.known["encoder_offset"]
        values["encoder_offset"]["offset"] += stated["offset"] * (jnp.arange(1, 4) == stated["joint"])
        return compose.predict(signals, values | {"gain": problem.known["gain"]})[:50]

    return reading


def test_readings_are_those_of_the_chain(problem, direct):
    """One call has several poses, and cables on several links."""
    z = np.random.default_rng(0).uniform(0.1, 0.5, (5, layout(3).size))
    z[:3, layout(3).of_effect("encoder_offset")] = z[0, layout(3).of_effect("encoder_offset")]
    z[:, layout(3).slices["cable", "link"]] = np.array([[0.0, 1.0, 1.0, 2.0, 3.0]]).T
    expected = [direct(one) for one in z]
    np.testing.assert_allclose(readings(problem, z), expected, rtol=1e-11, atol=1e-11)


def test_slopes_are_those_of_the_chain(problem, direct):
    """Derivatives along coordinates that move joints and others, in mixed order."""
    z = np.random.default_rng(1).uniform(0.1, 0.5, layout(3).size)
    z[layout(3).slices["cable", "link"]] = 1.0
    names = ("encoder_offset", "tool_mass", "gravity_tilt", "cable", "mount_rotation", "tool_flexibility")
    places = np.concatenate([layout(3).of_effect(name) for name in names])
    whole = layout(3).slices["cable", "link"].start  # an integer, along which nothing changes
    places = np.random.default_rng(2).permutation(places[places != whole])
    step = 1e-6 * np.eye(len(z))[places]
    expected = np.array([direct(z + d) - direct(z - d) for d in step]) / 2e-6
    got = slopes(problem, z, places)
    np.testing.assert_allclose(got, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
