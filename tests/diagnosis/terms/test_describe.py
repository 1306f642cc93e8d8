"""Terms replace effects, or effects replace terms, by what each explains of the reading, on synthetic fits."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ftbias_jax.diagnosis.candidates import Scored
from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.diagnosis.regression.design_matrix import Columns
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.terms import describe
from ftbias_jax.diagnosis.terms.fit_terms import Solved
from ftbias_jax.diagnosis.terms.grid import make_term
from ftbias_jax.model.effects.catalogue import CATALOGUE

PROBLEM = SimpleNamespace(catalogue=CATALOGUE)
BINS = 300
rng = np.random.default_rng(0)
BEFORE = rng.normal(size=(BINS, 6))
CHANGE = rng.normal(size=(BINS, 6)) * [0.1, 0.1, 0.1, 1.0, 8.0, 0.5]


@pytest.mark.parametrize(("removed", "holds"), [(0.43, False), (0.94, False), (0.96, True), (1.01, True)])
def test_terms_must_remove_as_much_of_the_gap_as_what_they_replace(monkeypatch, removed, holds):
    monkeypatch.setattr(describe, "gap_removed", lambda problem, before, after: after)

    def hold_out(fit, before):
        return SimpleNamespace(error=fit)

    assert describe._holds(None, hold_out, SimpleNamespace(error=0.0), removed, 1.0, 0.95) is holds


def fit_of(name, numbers, error, gain=0.0):
    columns = Columns(np.zeros((numbers, BINS, 6)), np.zeros((0, BINS, 6)))
    hypotheses = (Hypothesis(name),) if name else ()
    return Fit(hypotheses, np.zeros(3), np.zeros(0), error, columns, (), gain)


def described(change, drive=("orientation", "linear"), gain=0.0):
    """A term of 18 numbers that removes ``change`` from the residual."""
    term = make_term(*drive, "sensor", "wrench")
    term = term.__class__(**{**vars(term), "coefficients": np.zeros(18)})
    return Solved((term,), BEFORE - change, gain, np.zeros((18, BINS, 6)), np.zeros(0))


def only(channels):
    return np.where(np.isin(np.arange(6), channels), CHANGE, 0)


NEARLY = 1.05 * CHANGE


@pytest.mark.parametrize(
    ("effect", "of_effect", "term", "same"),
    [
        ("tool_com", NEARLY, described(CHANGE), True),
        ("tool_com", BEFORE * [0, 0, 0, 0.5, 0, 0] + only([4]), described(only([4])), True),  # and improves tx
        ("tool_com", BEFORE * [-1, 0, 0, 0, 0, 0] + only([4]), described(only([4])), False),  # and worsens fx
        ("tool_com", only([3]), described(CHANGE), False),
        ("tool_com", NEARLY, described(CHANGE, ("position", "linear")), False),  # does not follow gravity
        ("crosstalk", NEARLY, described(CHANGE), False),  # takes nearly any shape
    ],
)
def test_what_follows_gravity_as_a_wrong_tool_does_is_one(effect, of_effect, term, same):
    scored = Scored(fit_of(effect, 3, BEFORE - of_effect), 0.0)
    assert describe.is_equivalent_to_term(PROBLEM, scored, fit_of("", 0, BEFORE), term) == same


@pytest.mark.parametrize(
    ("effect", "drive", "gain", "rival"),
    [
        ("bias_jump", ("joint_velocity", "heat"), 1000.0, True),
        ("bias_jump", ("joint_velocity", "heat"), 500.0, False),
        ("bias_jump", ("time", "step"), 1000.0, False),  # equivalent
        ("cable", ("constant", "steady"), 1000.0, True),
        ("cable", ("position", "linear"), 1000.0, False),  # equivalent
        ("warmup", ("joint_velocity", "heat"), 1000.0, False),  # is neither an event nor a pull
    ],
)
def test_an_event_or_a_pull_that_something_else_explains_as_well_has_a_rival(effect, drive, gain, rival):
    accepted = fit_of(effect, 6, BEFORE, 900.0)
    term = described(CHANGE, drive, gain)
    found = describe._rivals(PROBLEM, fit_of("", 0, BEFORE), accepted, [(0.0, term)])
    assert bool(found) == rival


@pytest.mark.parametrize(("drive", "taken"), [(("temperature", "calibrated"), True), (("orientation", "map"), False)])
def test_one_term_takes_the_place_of_several_effects_that_explain_no_more(monkeypatch, drive, taken):
    """Gauges whose gain depends on temperature: gains explain most, temperature drift explains the rest."""
    base = fit_of("", 0, BEFORE)
    first = fit_of("gain", 3, BEFORE, 990.0)
    both = first._replace(hypotheses=(Hypothesis("gain"), Hypothesis("temperature_drift")), log_likelihood=1000.0)
    both = both._replace(columns=Columns(np.zeros((9, BINS, 6)), np.zeros((0, BINS, 6))))
    term = described(CHANGE, drive, 1005.0)
    term = term._replace(terms=tuple(replace(one, coefficients=np.zeros(6)) for one in term.terms))
    merit = describe.merit_of(1005.0, describe.numbers_of(term.terms[0]))
    step = SimpleNamespace(described=SimpleNamespace(fit=base._replace(log_likelihood=1005.0), terms=term.terms))
    search = SimpleNamespace(
        best=lambda start: [(merit, term)] if start is base else [],
        grow=lambda start, found: [step] if start is base else [],
    )
    monkeypatch.setattr(describe, "Search", lambda *given: search)
    monkeypatch.setattr(describe, "_holds", lambda *given: True)
    rounds = [[Scored(first, 0.0)], [Scored(both, 0.0)]]
    outcome = describe.describe(PROBLEM, None, base, both, rounds, explained=True)
    assert (outcome.description is not None) is taken
