"""A bias that wanders more than stated: its density is found, reported and applied; nothing else is mistaken for it."""

from types import SimpleNamespace

import numpy as np
import pytest
from made_series import wandering

from ftbias_jax.diagnosis.apply import refused, with_causes
from ftbias_jax.diagnosis.diagnose import diagnose
from ftbias_jax.diagnosis.problem import make_problem
from ftbias_jax.diagnosis.regression.fit import base
from ftbias_jax.diagnosis.terms.wander import _left, _nats, _went, wander_of
from ftbias_jax.filtering.noise.wander import LEAST_WENT, LEAST_WENT_OF_ALL

MORE = 30.0


@pytest.fixture(scope="module")
def wild(setup, record):
    """The plain log with a bias that wanders ``MORE`` times as much as the setup states."""
    log = record(None)
    added = wandering(np.random.default_rng(5), np.asarray(log.t), MORE * setup.bias.noise_density)
    return log._replace(wrench=log.wrench + added)


def test_a_bias_that_wanders_is_told_with_its_density_and_applied(setup, wild):
    found = diagnose(setup, wild)
    (term,) = found.terms
    assert (found.verdict, found.causes) == ("described", ())
    assert (term.drive, term.form, term.acts_as) == ("noise", "wander", "bias")
    assert found.sentence.startswith("The bias wanders more than stated (noise_density ")
    density, stderr = (np.concatenate([x["N_per_s1.5"], x["Nm_per_s1.5"]]) for x in (term.coefficients, term.stderr))
    true = MORE * setup.bias.noise_density
    assert (np.abs(density - true) < 3.5 * stderr).all()
    assert (stderr < 0.4 * density).all()
    assert term.shrink == pytest.approx(found.gap.shrink, abs=1e-9)
    assert found.gap.shrink > 0.9
    mended = found.apply(setup)
    np.testing.assert_array_equal(mended.bias.noise_density, density)
    assert mended.effects == setup.effects
    assert refused(setup, found.causes, found.terms) == ()
    assert diagnose(mended, wild).verdict == "none"


def test_a_term_of_wandering_leaves_the_effects_of_the_setup(setup):
    term = SimpleNamespace(form="wander", statement="", section={"noise_density": [0.1] * 3 + [0.01] * 3})
    mended = with_causes(setup, (), (term,))
    np.testing.assert_array_equal(mended.bias.noise_density, [0.1] * 3 + [0.01] * 3)
    np.testing.assert_array_equal(mended.tool.mass, setup.tool.mass)


@pytest.mark.parametrize("follows", ["angle", "speed", "time"])
def test_what_comes_back_is_no_bias_that_wanders(setup, record, follows):
    log = record(None)
    drive = {"angle": log.q[:, 4], "speed": log.dq[:, 3], "time": np.sin(2.0 * np.asarray(log.t))}[follows]
    wrench = log.wrench + 20 * setup.sensor.noise_std * np.asarray(drive)[:, None]
    problem, _ = make_problem(setup, [log._replace(wrench=wrench)])
    assert wander_of(problem, base(problem)) is None


@pytest.mark.slow
def test_a_bias_that_follows_the_temperature_is_no_bias_that_wanders(setup, record):
    """This holds for any time course of the temperature, and for a bias that is not quite linear in it."""
    log = record(None)
    course = wandering(np.random.default_rng(7), np.asarray(log.t), np.ones(6))[:, 0]
    course = (course - course.mean()) / course.std()
    added = setup.sensor.noise_std * (20 * course + 0.5 * course**2)[:, None]
    found = diagnose(setup, log._replace(wrench=log.wrench + added, temperature=30 + 3 * course))
    assert [cause.effect for cause in found.causes] == ["temperature_drift"]
    assert "wander" not in [term.form for term in found.terms]


def test_a_bias_as_stated_is_no_finding(setup, record):
    problem, _ = make_problem(setup, [record(None)])
    assert wander_of(problem, base(problem)) is None


def test_nats_are_those_of_one_filter_after_the_other(setup, wild):
    problem, _ = make_problem(setup, [wild])
    part = problem.parts[0]
    density = np.array([setup.bias.noise_density, MORE * setup.bias.noise_density])
    left = _left(problem, base(problem))
    found = _nats(problem, left, density)
    assert found.shape == (part.used, 2, 6)
    dt, variance = np.asarray(part.wrench.dt), np.asarray(part.wrench.variance)
    prior = np.asarray(part.wrench.prior_std) ** 2
    for g, axis in ((0, 0), (1, 4)):
        x, P, total = np.zeros(2), np.diag([prior[axis], prior[6 + axis]]), 0.0
        for k in range(part.used):
            h = dt[k]
            A, q = np.array([[1, h], [0, 1]]), density[g, axis] ** 2
            x, P = A @ x, A @ P @ A.T + q * np.array([[h**3 / 3, h**2 / 2], [h**2 / 2, h]])
            if np.isfinite(left[0][k, axis]):
                s = P[0, 0] + variance[k, axis]
                v = left[0][k, axis] - x[0]
                total -= (np.log(s) + v**2 / s) / 2
                x, P = x + P[:, 0] / s * v, P - np.outer(P[:, 0], P[0]) / s
        assert found[:, g, axis].sum() == pytest.approx(total, rel=1e-9)


def test_a_bias_goes_as_far_as_its_density_says_and_seldom_less():
    rng, t, density = np.random.default_rng(1), np.arange(3000) * 0.02, np.linspace(0.5, 2, 6)
    part = SimpleNamespace(used=len(t), signals=SimpleNamespace(t=t))
    went = np.array([_went(SimpleNamespace(parts=(part,)), [wandering(rng, t, density)], density) for _ in range(300)])
    np.testing.assert_allclose(went.mean(0), 1, atol=5 * went.std() / np.sqrt(len(went)))
    assert (went < LEAST_WENT).mean() < 0.005
    assert (went.mean(1) < LEAST_WENT_OF_ALL).mean() < 0.005
