"""Each rule of the search separately, on synthetic fits: acceptance of causes, redundant causes, trials of pairs."""

import numpy as np
import pytest
from small_fits import small_fit

from ftbias_jax.diagnosis import search as searching
from ftbias_jax.diagnosis.candidates import Scored
from ftbias_jax.diagnosis.evidence.gap import HeldOut
from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.search import Search, Threshold
from ftbias_jax.diagnosis.thresholds import LEAST_GAIN, PENALTY_PER_PARAMETER

BINS, SECONDS = 480, 48.0
T = np.linspace(0, SECONDS, BINS, endpoint=False)
ONES = np.ones((BINS, 6))
PROBLEM = Problem((), T, np.zeros(BINS), ONES, ONES, T, (SECONDS,), np.ones(6), {})
NO_COLUMNS = np.zeros((0, BINS, 6))


def fit_of(squares, *names, local=False):
    """A fit of these effects that leaves squared innovations (BINS,)."""
    hypotheses = tuple(Hypothesis(name, shapes=(squares * 0,) if local else (), local=local) for name in names)
    error = np.sqrt(np.broadcast_to(np.asarray(squares, float), (BINS,)))[:, None] * ONES
    return small_fit(NO_COLUMNS, error, (), hypotheses)


def search_of(start, hold_out=None):
    return Search(PROBLEM, start, hold_out, None)


GAP = np.full(BINS, 2.0)
"""Squares of the nominal model: a mean square gap of one noise variance."""
FIRST_BLOCK = T < 2.0


def test_parameters_that_nothing_can_have_are_no_cause(monkeypatch):
    accepted, trial = fit_of(GAP), Scored(fit_of(GAP - 1.0, "tool_inertia"), 100.0)
    search = search_of(accepted, lambda fit, reference: HeldOut(fit.error, 100.0, 200.0, 1.0))
    for moment, acceptable in ((1.0, True), (-1.0, False)):
        values = {"inertia": [moment, 0.0, 0.0, 1.0, 0.0, 1.0]}
        monkeypatch.setattr(searching, "parameters", lambda *_, v=values: (v, {"inertia": [0.1] * 6}))
        assert search.is_acceptable(Threshold(PROBLEM, 0.08**2), accepted, trial) is acceptable


@pytest.mark.parametrize(
    ("why", "effect", "nats", "leaves", "held", "acceptable"),
    [
        ("all is well", "tool_mass", 13.0, GAP - 0.1, (3.0, 1.0), True),
        ("too little is gained beyond the price", "tool_mass", 11.9, GAP - 0.1, (3.0, 1.0), False),
        ("one block gains it all", "tool_mass", 500.0, GAP - 2.0 * FIRST_BLOCK, (3.0, 1.0), False),
        ("what is sudden gains in one block", "bias_jump", 500.0, GAP - 2.0 * FIRST_BLOCK, (3.0, 1.0), True),
        ("unseen blocks do not gain surely", "tool_mass", 13.0, GAP - 0.1, (1.9, 1.0), False),
        ("what is sudden gains in too few of them", "bias_jump", 13.0, GAP - 0.1, (1.9, 1.0), True),
        ("it removes less than the owner would see", "tool_mass", 13.0, GAP - 0.006, (3.0, 1.0), False),
        ("it removes as much as the owner would see", "tool_mass", 13.0, GAP - 0.007, (3.0, 1.0), True),
    ],
)
def test_what_a_cause_must_do(why, effect, nats, leaves, held, acceptable):
    accepted, trial = fit_of(GAP), fit_of(leaves, effect)

    def hold_out(fit, reference):
        nats, by_noise = held
        return HeldOut(fit.error, nats, 2 * nats, by_noise)  # it gains in one block more than in others

    got = search_of(accepted, hold_out).is_acceptable(Threshold(PROBLEM, 0.08**2), accepted, Scored(trial, nats))
    assert got is acceptable, why


@pytest.mark.parametrize(
    ("before", "after", "stands_out"),
    [
        (0.0, 1.0, True),  # nothing else acts at that time
        (10.0, 1.1, True),  # slightly over a tenth of what the others removed there
        (10.0, 0.9, False),
    ],
)
def test_events_must_do_more_than_tidy_up_after_other_causes(before, after, stands_out):
    """Squares that other causes removed at the time of the events, and squares that the events remove."""
    start, accepted, trial = fit_of(20.0 + 0 * T), fit_of(20.0 - before + 0 * T), fit_of(20.0 - before - after + 0 * T)
    event = Hypothesis("contact", shapes=((T > 3) & (T < 5),), local=True)
    trial = trial._replace(hypotheses=(event,))
    assert search_of(start).stands_out(accepted, trial) is stands_out


@pytest.mark.parametrize(
    ("share", "gap", "enough"),
    [(0.0, 0.0, 0.08**2), (0.0, 1.0, 0.02), (0.0, 0.1, 0.08**2)],
)
def test_a_further_cause_must_remove_a_share_of_the_gap(share, gap, enough):
    start = fit_of(1 + gap + 0 * T)
    accepted = start._replace(hypotheses=(Hypothesis("tool_mass"),))
    assert search_of(start).threshold(accepted).least == pytest.approx(enough)


@pytest.mark.parametrize(("first", "enough"), [("tool_mass", 0.08**2), ("contact", 0.02), ("warmup", 0.02)])
def test_a_slow_effect_on_the_bias_needs_a_share_only_beside_what_does_not_follow_the_motion(first, enough):
    start = fit_of(2.0 + 0 * T)
    accepted = start._replace(hypotheses=(Hypothesis(first),))
    assert search_of(start).threshold(accepted).least_of_slow == pytest.approx(enough)


@pytest.mark.parametrize(
    ("why", "effect", "before", "alone", "acceptable"),
    [
        ("all that is left is slow", "warmup", 1.01, 1.01, True),
        ("the other causes moved on with it", "warmup", 1.01, 1.0, False),
        ("more is left, of which it may be a part", "warmup", 1.04, 1.04, False),
        ("a jump is like many an error of form", "bias_jump", 1.01, 1.01, False),
        ("what follows the motion even more so", "gain", 1.01, 1.01, False),
    ],
)
def test_a_slow_effect_on_the_bias_is_no_error_of_the_form_of_another(
    monkeypatch, why, effect, before, alone, acceptable
):
    """The effect removes a hundredth of the gap; any other effect would have to remove a fiftieth."""
    accepted, trial = fit_of(before + 0 * T), fit_of(before - 0.01 + 0 * T, effect)
    rest = fit_of(alone + 0 * T)._replace(log_likelihood=trial.log_likelihood - 500.0)
    monkeypatch.setattr(searching, "fit", lambda problem, hypotheses, start: rest)

    def hold_out(fit, reference):
        return HeldOut(fit.error, 3.0, 3.0, 1.0)

    got = search_of(accepted, hold_out).is_acceptable(Threshold(PROBLEM, 0.02, 0.08**2), accepted, Scored(trial, 500.0))
    assert got is acceptable, why


@pytest.mark.parametrize(
    ("loss", "degrees", "redundant"),
    [
        (LEAST_GAIN + PENALTY_PER_PARAMETER + 1, 1, False),
        (LEAST_GAIN + PENALTY_PER_PARAMETER - 1, 1, True),
        (LEAST_GAIN + 2 * PENALTY_PER_PARAMETER, 3, True),  # three parameters cost more than one
    ],
)
def test_a_cause_that_later_ones_make_needless_is_dropped(monkeypatch, loss, degrees, redundant):
    """A cause is redundant if the fit without it loses less than a cause must gain."""
    both = fit_of(GAP, "tool_mass", "gain")
    columns = both.columns._replace(moving=np.zeros((degrees, BINS, 6)))
    both = both._replace(columns=columns)

    def refit(problem, hypotheses, start):
        alone = start.columns._replace(moving=np.zeros((0, BINS, 6)))
        return start._replace(hypotheses=hypotheses, columns=alone, log_likelihood=start.log_likelihood - loss)

    monkeypatch.setattr(searching, "fit", refit)
    rest = search_of(fit_of(GAP)).without_redundant(both)
    assert (rest is not None) is redundant
    if redundant:
        assert [h.effect for h in rest.hypotheses] == ["gain"]  # the later cause made it redundant


def test_rounds_are_fitted_again_without_the_cause_that_was_dropped(monkeypatch):
    found = ("tool_mass", "gain", "warmup")
    rounds = [[Scored(fit_of(GAP, *found[:k]), 100.0), Scored(fit_of(GAP, "cable"), 9.0)] for k in (1, 2, 3)]
    monkeypatch.setattr(searching, "fit", lambda problem, hypotheses, start: start._replace(hypotheses=hypotheses))
    first, second = search_of(fit_of(GAP)).rounds_of(fit_of(GAP, "gain", "warmup"), rounds)
    assert [h.effect for h in first[0].fit.hypotheses] == ["gain"]
    assert [h.effect for h in second[0].fit.hypotheses] == ["gain", "warmup"]
    assert [scored.hypothesis.effect for scored in (first[1], second[1])] == ["cable", "cable"]


@pytest.mark.parametrize(
    ("gains", "others"),
    [
        ({"tool_mass": 100.0, "gain": 31.0, "tool_com": 99.0}, ["gain"]),  # one other cause alone
        ({"tool_mass": 100.0, "warmup": 90.0, "gain": 80.0}, ["gain"]),  # an accepted cause replaces no other
        ({"tool_mass": 100.0, "gain": 29.0}, []),  # too weak
        ({"tool_mass": 100.0, "warmup": 90.0}, []),  # already a cause
    ],
)
def test_pairs_are_tried_from_strong_other_firsts(gains, others):
    first = [Scored(fit_of(GAP, name), gain) for name, gain in gains.items()]
    accepted = fit_of(GAP, "tool_mass", "warmup")
    assert [s.hypothesis.effect for s in searching.other_firsts(first, accepted)] == others


@pytest.mark.parametrize(
    ("why", "causes", "left", "gained", "adopted"),
    [
        ("the pair is better", ("gain", "warmup"), 0.05, LEAST_GAIN + 1, True),
        ("the pair is hardly better", ("gain", "warmup"), 0.05, LEAST_GAIN - 1, False),
        ("one cause is no pair", ("gain",), 0.05, LEAST_GAIN + 1, False),
        ("nothing is left to explain", ("gain", "warmup"), 0.005, LEAST_GAIN + 1, False),
        ("of three causes a pair might do as well", ("gain", "warmup", "tool_com"), 0.005, LEAST_GAIN + 1, True),
        ("much is left: it is in no catalogue", ("gain", "warmup"), 0.15, LEAST_GAIN + 1, False),
    ],
)
def test_when_a_pair_takes_the_place_of_what_was_found(monkeypatch, why, causes, left, gained, adopted):
    start, greedy = fit_of(GAP), fit_of(1 + left + 0 * T, *causes)
    pair = greedy._replace(hypotheses=(Hypothesis("tool_mass"), Hypothesis("warmup")))
    pair = pair._replace(log_likelihood=greedy.log_likelihood + gained)
    first = [Scored(fit_of(GAP, name), 100.0) for name in ("gain", "tool_mass")]

    def grow(self, rounds, most=3):
        return (pair, [*rounds, []]) if rounds else (greedy, [first])

    monkeypatch.setattr(Search, "grow", grow)
    found, _ = search_of(start).best()
    assert (found is pair) is adopted, why
