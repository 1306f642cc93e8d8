"""Tools on springs: which forms are tried, and which fits are believed."""

from types import SimpleNamespace

import numpy as np
import pytest
from small_fits import small_fit

from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.diagnosis.proposals import flexibility
from ftbias_jax.diagnosis.regression import chain_model

PROBLEM = SimpleNamespace(joints=7)
NO_COLUMNS = np.zeros((0, 4, 6))


def coordinate(parameter, way=0):
    return chain_model.slices(7)[flexibility.EFFECT, parameter].start + way


def found(hypothesis, **values):
    """A fit of one hypothesis with these coordinates."""
    z = np.zeros(chain_model.size(7))
    for name, value in values.items():
        z[coordinate(name)] = value
    return small_fit(NO_COLUMNS, np.zeros((4, 6)), (), (hypothesis,))._replace(z=z)


def test_the_usual_tool_turns_about_x_and_y_and_sags():
    for h in flexibility.usual(PROBLEM):
        assert set(h.free) == {coordinate("period"), coordinate("log_damping")}
        moving = {place: value for place, value in h.fixed if value}
        assert moving == {coordinate("share", 3): 1.0, coordinate("share", 4): 1.0, coordinate("sagging"): 1.0}


def test_a_freed_tool_starts_where_it_was_found():
    usual = flexibility.usual(PROBLEM)[0]
    fit = found(usual, period=1.7, log_damping=0.4)
    fit.z[[coordinate("share", 3), coordinate("share", 4), coordinate("sagging")]] = 1
    general = flexibility.freed(PROBLEM, fit)
    assert general.fixed == ()
    assert dict(zip(general.free, general.start, strict=True)) == {
        coordinate("period"): 1.7,
        coordinate("log_damping"): 0.4,
        coordinate("share", 0): 0.0,
        coordinate("share", 1): 0.0,
        coordinate("share", 3): 1.0,
        coordinate("share", 4): 1.0,
        coordinate("sagging"): 1.0,
    }
    assert flexibility.freed(PROBLEM, found(general)) is None
    assert flexibility.start_of(usual) not in (
        flexibility.start_of(general),
        flexibility.start_of(general._replace(start=(0.0,))),
    )
    assert flexibility.freed(PROBLEM, found(Hypothesis("low_pass"))) is None


@pytest.mark.parametrize(
    ("hertz", "log_damping", "loss", "plausible"),
    [
        (5.0, 0.3, 90.0, True),
        (3.5, 0.3, 90.0, False),
        (2.0, 0.3, 0.0, False),
        (5.0, chain_model.MOST_LOG_DAMPING, 90.0, False),
        (5.0, chain_model.MOST_LOG_DAMPING, 1.0, True),
    ],
)
def test_what_needs_the_limits_is_no_tool_on_springs(monkeypatch, hertz, log_damping, loss, plausible):
    """Of 100 nats gained, a usual damping loses so many."""
    free = (coordinate("period"), coordinate("log_damping"))
    best = found(Hypothesis(flexibility.EFFECT, free, (0.0, 0.0)), period=10 / hertz, log_damping=log_damping)
    worse = best._replace(log_likelihood=best.log_likelihood - 100)

    def refit(problem, hypotheses, start):
        assert hypotheses[-1].fixed == ((free[1], 0.0),)
        assert hypotheses[-1].free == free[:1]
        return start._replace(log_likelihood=start.log_likelihood - loss)

    monkeypatch.setattr(flexibility, "fit", refit)
    assert flexibility.is_plausible(PROBLEM, worse, best) is plausible
    assert flexibility.is_plausible(PROBLEM, worse, best._replace(hypotheses=(Hypothesis("low_pass"),)))


def test_a_log_on_which_no_spring_gains_still_has_a_start():
    tried = [(-2.0, Hypothesis("tool_flexibility", (0, 1, 2), (3.0, -2.0, 0.4))), (-1.0, Hypothesis("", ()))]
    gain, start = flexibility._stiffest(tried)
    assert (gain, start.start) == (-2.0, (3.0, -2.0, 0.4))
