"""Gains of a dictionary of terms against those of the same columns evaluated one by one."""

from types import SimpleNamespace

import numpy as np
import pytest
from made_states import still_state
from small_fits import at_its_best

from ftbias_jax.diagnosis.regression.design_matrix import Columns
from ftbias_jax.diagnosis.regression.score_test import gains, prepare_fit
from ftbias_jax.diagnosis.regression.whitening import Whitener
from ftbias_jax.diagnosis.terms.dictionary import _arms, _gains, make_dictionary
from ftbias_jax.diagnosis.terms.grid import make_term
from ftbias_jax.model.effects.terms.columns import columns

BINS = 60
TERMS = [
    make_term("velocity", "linear", "base", "force"),
    make_term("velocity", "linear", "base", "torque"),
    make_term("constant", "steady", "base", "wrench"),
    make_term("time", "quadratic", "sensor", "wrench"),
    make_term("load", "cube", "sensor", "wrench"),
    make_term("time", "wave", "base", "force", 0, {"frequency": 0.05}),
    make_term("joint_angle", "cubic", "joint", "torque", 1),
]


@pytest.fixture
def state():
    rng = np.random.default_rng(3)
    state = still_state(rng.normal(size=BINS), rng.normal(size=(BINS, 3)))
    turned = np.linalg.qr(rng.normal(size=(BINS, 3, 3)))[0]
    return state._replace(rotation=turned, velocity=rng.normal(size=(BINS, 3)), load=rng.normal(size=(BINS, 6)))


@pytest.fixture
def problem():
    """One log whose readings are already white."""
    one, none = np.tile(np.eye(BINS), (6, 1, 1, 1)), np.zeros((6, 1, BINS, 2))
    white = Whitener(one, none, none.transpose(0, 1, 3, 2), np.zeros((6, 1, 2, 2)))
    return SimpleNamespace(t=np.arange(float(BINS)), parts=[SimpleNamespace(whiten=white, used=BINS)])


@pytest.mark.parametrize("series", [0, 2])
def test_gains_of_a_whole_grid_are_those_of_each_terms_columns(problem, state, series):
    rng = np.random.default_rng(series)
    fit = at_its_best(rng, 2, BINS)
    fit = fit._replace(columns=Columns(fit.columns.moving, rng.normal(size=(series, BINS, 6))))
    prepared_fit = prepare_fit(fit)
    for term, found in zip(TERMS, _gains(make_dictionary(problem, state, TERMS), prepared_fit), strict=True):
        own = columns(np, term, state).transpose(1, 0, 2)
        if (term.acts_as == "force" and term.form != "wave") or term.form == "steady":
            vectors = own[: 3 if term.form == "steady" else None, :, :3].transpose(1, 0, 2)
            own = np.concatenate([own, _arms(vectors).transpose(1, 0, 2)])
        expected = gains(prepared_fit, own)
        scale = np.abs(expected.normal).max()
        np.testing.assert_allclose(found.normal, expected.normal, atol=1e-5 * scale, err_msg=str(term))
        np.testing.assert_allclose(found.pull, expected.pull, atol=1e-5 * np.sqrt(scale * BINS), err_msg=str(term))
