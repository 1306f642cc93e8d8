"""Twins on synthetic fits: equally good, nearly as good, and declared alike by the catalogue."""

from types import SimpleNamespace

import numpy as np
import pytest
from small_fits import small_fit

from ftbias_jax.diagnosis.candidates import Scored
from ftbias_jax.diagnosis.evidence import causes
from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.model.effects.catalogue import CATALOGUE

BLOCKS = 25
JOINTS = SimpleNamespace(coherent=np.zeros((100, 6)))
PROBLEM = SimpleNamespace(
    catalogue=CATALOGUE, samples=np.full((100, 6), 1000.0), variance=np.ones((100, 6)), parts=(JOINTS,)
)
CAUSE = Hypothesis("tool_mass")


def fit_of(hypothesis, log_likelihood):
    nothing = small_fit(np.zeros((0, 100, 6)), np.zeros((100, 6)), (), (hypothesis,) if hypothesis else ())
    return nothing._replace(log_likelihood=log_likelihood)


def twins_of(monkeypatch, losses, scatter, preliminary=1000.0, gain=1000.0, problem=PROBLEM):
    """Twins of a cause with this gain; the others lose these nats, scattered over the blocks by ``scatter`` each."""
    base, accepted = fit_of(None, -gain), fit_of(CAUSE, 0.0)
    others = [Scored(fit_of(Hypothesis(name), -lost), preliminary) for name, lost in losses.items()]
    lost = {id(other.fit.error): -other.fit.log_likelihood for other in others}

    def log_likelihood_gain(problem, better, worse):
        assert better is accepted.error
        return lost[id(worse)], np.sqrt(BLOCKS) * scatter

    monkeypatch.setattr(causes, "log_likelihood_gain", log_likelihood_gain)
    scored = [Scored(accepted, 1000.0), *others]
    return causes.twins_of(problem, base, accepted, CAUSE, scored)


@pytest.mark.parametrize(
    ("why", "other", "lost", "scatter", "named"),
    [
        ("within three standard errors", "tool_inertia", 14.0, 1.0, True),
        ("beyond three standard errors", "tool_inertia", 16.0, 1.0, False),
        ("a few nats never decide", "tool_inertia", 5.9, 0.01, True),
        ("more of them do", "tool_inertia", 6.1, 0.01, False),
        ("less than its form may cost a declared twin", "gain", 19.0, 0.01, True),
        ("more than that", "gain", 21.0, 0.01, False),
        ("a large error does not make a twenty-fifth of the gain", "tool_inertia", 49.0, 10.0, True),
        ("nor a share that is too large", "tool_inertia", 51.0, 10.0, False),
    ],
)
def test_who_is_a_twin(monkeypatch, why, other, lost, scatter, named):
    assert twins_of(monkeypatch, {other: lost}, scatter) == ((other,) if named else ()), why


def test_errors_of_the_joints_may_make_the_difference_to_a_declared_twin(monkeypatch):
    noisy = SimpleNamespace(coherent=np.full((100, 6), 0.6))
    unsure = SimpleNamespace(**vars(PROBLEM) | {"parts": (noisy,)})
    assert twins_of(monkeypatch, {"gain": 45.0}, 0.01, problem=unsure) == ("gain",)
    assert twins_of(monkeypatch, {"tool_inertia": 45.0}, 0.01, problem=unsure) == ()


def test_a_rough_fit_that_is_far_off_is_not_tried(monkeypatch):
    assert twins_of(monkeypatch, {"gain": 0.0}, 1.0, preliminary=701.0) == ("gain",)
    assert twins_of(monkeypatch, {"gain": 0.0}, 1.0, preliminary=699.0) == ()


def test_three_are_told_the_best_first(monkeypatch):
    near = ("gain", "tool_com", "tool_inertia", "crosstalk", "low_pass")
    assert twins_of(monkeypatch, dict.fromkeys(near, 1.0), 1.0) == near[:3]
    assert twins_of(monkeypatch, {CAUSE.effect: 0.0}, 1.0) == ()  # a cause is no twin of itself
