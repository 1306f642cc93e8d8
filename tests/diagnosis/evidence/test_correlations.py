from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
from small_fits import small_fit

from ftbias_jax.diagnosis.evidence import estimates
from ftbias_jax.diagnosis.hypothesis import Hypothesis, Slow
from ftbias_jax.diagnosis.regression.coordinates import layout
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.model.effects.types import Model, Signals
from ftbias_jax.model.kinematics.screws import Arm
from ftbias_jax.model.wrench.tool_wrench import tool_parameters

THETA = tool_parameters(jnp.asarray(0.73), jnp.array([0.0, 0.01, 0.06]), jnp.array([2e-3, 0, 0, 2e-3, 0, 1e-3]))


def made(make_candidate):
    """A problem, a fit of mass, a joint's offset and a warm-up, and causes in another order, one of them of samples."""
    n, nothing = 2, jnp.zeros((1, 2))
    arm = Arm(jnp.zeros((n, 3)), jnp.zeros((n, 3)).at[:, 2].set(1), jnp.zeros(3), jnp.eye(3))
    signals = Signals(
        jnp.zeros(1), nothing, nothing, nothing, jnp.zeros(1), Model(arm, jnp.array([0, 0, -9.81]), THETA)
    )
    places = layout(n, CATALOGUE)
    problem = SimpleNamespace(catalogue=CATALOGUE, parts=[SimpleNamespace(signals=signals)])
    mass = places.slices["tool_mass", "mass"].start
    offset = places.slices["encoder_offset", "offset"].start + 1
    hypotheses = (
        Hypothesis("tool_mass", (mass,)),
        Hypothesis("encoder_offset", (offset,), detail=2),
        Hypothesis("warmup", shapes=(np.ones(5),), detail=Slow(9.0, None)),
    )
    fit = small_fit(np.zeros((2, 5, 6)), np.zeros((5, 6)), (mass, offset), hypotheses)
    fit = fit._replace(z=np.zeros(places.size), coefficients=np.zeros(6))
    causes = [
        make_candidate("warmup", parameters={"amplitude": [0.1] * 6, "tau": 9.0}),
        make_candidate("quantisation", parameters={"step": [0.1] * 6}),
        make_candidate("encoder_offset", parameters={"offset": 0.01, "joint": 2}),
        make_candidate("tool_mass", parameters={"mass": 0.8}),
    ]
    return problem, fit, causes


def test_correlations_are_those_of_the_fit_in_the_order_of_the_causes(make_candidate, monkeypatch):
    problem, fit, causes = made(make_candidate)
    root = np.random.default_rng(0).normal(size=(8, 8))
    spread = root @ root.T
    monkeypatch.setattr(estimates, "covariance", lambda problem, fit: spread)
    found = estimates.correlations(problem, fit, causes)
    # Fit: mass, offset, six amplitudes; causes: amplitudes, tau, steps, offset, joint, mass.
    order = {**{k: 2 + k for k in range(6)}, 13: 1, 15: 0}
    std = np.sqrt(np.diag(spread))
    expected = np.eye(16)
    for i, a in order.items():
        for j, b in order.items():
            expected[i, j] = spread[a, b] / std[a] / std[b]
    np.testing.assert_allclose(np.abs(found), np.abs(expected), atol=1e-6)
    np.testing.assert_allclose(found[:6, :6], expected[:6, :6], atol=1e-6)


def test_without_a_covariance_all_is_independent(make_candidate, monkeypatch):
    problem, fit, causes = made(make_candidate)

    def refuse(problem, fit):
        raise np.linalg.LinAlgError

    monkeypatch.setattr(estimates, "covariance", refuse)
    np.testing.assert_array_equal(estimates.correlations(problem, fit, causes), np.eye(16))
    assert estimates.correlations(problem, fit, []).shape == (0, 0)
