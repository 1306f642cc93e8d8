"""Terms fitted to synthetic readings that the bias filter does not change."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from made_states import still_state
from small_fits import at_its_best

from ftbias_jax.diagnosis.regression.score_test import prepare_fit
from ftbias_jax.diagnosis.terms.fit_terms import fit_terms, improve
from ftbias_jax.diagnosis.terms.grid import make_term
from ftbias_jax.model.effects.terms.columns import added

BINS = 200
NOISE_STD = 0.01
"""N, Nm."""
POINT = np.array([0.03, -0.05, 0.2])


@pytest.fixture
def problem():
    return SimpleNamespace(t=np.arange(float(BINS)), parts=[SimpleNamespace(whiten=lambda x: x / NOISE_STD, used=BINS)])


@pytest.fixture
def state():
    rng = np.random.default_rng(3)
    turned = np.linalg.qr(rng.normal(size=(BINS, 3, 3)))[0]
    moving = {name: rng.normal(size=(BINS, 3)) for name in ("velocity", "angular_velocity")}
    return still_state(rng.normal(size=BINS), rng.normal(size=(BINS, 3)))._replace(rotation=turned, **moving)


def fit_with(term, state, own):
    """A fit that lacks a term; innovations are prediction - reading."""
    start = at_its_best(np.random.default_rng(0), own, BINS)
    error = start.error - added(np, term, state) / NOISE_STD
    return start._replace(error=error, log_likelihood=-float((error**2).sum()) / 2)


@pytest.mark.parametrize("own", [0, 3])
@pytest.mark.parametrize(
    ("form", "size"),
    [(("velocity", "linear"), [2.0]), (("time", "wave"), [3.0, -1.0, 0.5, 0.2, 1.0, -2.0])],
)
def test_the_point_and_the_coefficients_of_a_force_are_found(problem, state, own, form, size):
    numbers = {"frequency": 0.0123} if form[0] == "time" else {}
    term = replace(make_term(*form, "base", "force", 0, numbers, POINT), coefficients=np.array(size))
    start = {name: 1.0005 * value for name, value in numbers.items()}
    found = fit_terms(
        problem, state, prepare_fit(fit_with(term, state, own)), (make_term(*form, "base", "force", 0, start),)
    )
    np.testing.assert_allclose(found.terms[0].coefficients, size, atol=0.02)
    np.testing.assert_allclose(found.terms[0].point, POINT, atol=0.003)
    assert found.fit.columns.size == own + len(size) + len(numbers) + 3
    assert len(found.scales[0]) == len(size) + len(numbers) + 3


def test_more_steps_never_lose(problem, state):
    term = replace(make_term("velocity", "linear", "base", "force", 0, {}, POINT), coefficients=np.array([2.0]))
    prepared_fit = prepare_fit(fit_with(term, state, 2))
    wrong = make_term("velocity", "linear", "base", "force", 0, {}, -2 * POINT)
    likely = [improve(problem, state, prepared_fit, (wrong,), steps).log_likelihood for steps in (0, 1, 2, 5)]
    assert likely == sorted(likely)
    assert likely[-1] > likely[0]
