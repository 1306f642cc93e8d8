"""Tools on springs: which forms are tried, and which fits are accepted."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from small_fits import small_fit

from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.diagnosis.proposals import ringing
from ftbias_jax.diagnosis.regression.coordinates import layout
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.model.effects.types import Model

EFFECT = "tool_flexibility"
MODEL = Model(None, jnp.zeros(3), jnp.ones(10))
NO_COLUMNS = np.zeros((0, 4, 6))
LAYOUT = layout(7)
LEAST, MOST = LAYOUT.least, LAYOUT.most
PART = SimpleNamespace(signals=SimpleNamespace(model=MODEL))
PROBLEM = SimpleNamespace(layout=LAYOUT, catalogue=CATALOGUE, parts=[PART])


def coordinate(parameter, way=0):
    return LAYOUT.slices[EFFECT, parameter].start + way


MOST_DAMPED = MOST[coordinate("damping_ratio")]


def found(hypothesis, **values):
    """A fit of one hypothesis with these coordinates."""
    z = np.zeros(LAYOUT.size)
    for name, value in values.items():
        z[coordinate(name)] = value
    return small_fit(NO_COLUMNS, np.zeros((4, 6)), (), (hypothesis,))._replace(z=z)


def test_the_usual_tool_turns_about_x_and_y_and_sags():
    for h in ringing.usual(PROBLEM, ()):
        assert set(h.free) == {coordinate("frequency"), coordinate("damping_ratio")}
        moving = {place: value for place, value in h.fixed if value}
        assert moving == {coordinate("share", 3): 1.0, coordinate("share", 4): 1.0, coordinate("sagging"): 1.0}


def test_a_freed_tool_starts_where_it_was_found():
    usual = ringing.usual(PROBLEM, ())[0]
    fit = found(usual, frequency=1.7, damping_ratio=0.4)
    fit.z[[coordinate("share", 3), coordinate("share", 4), coordinate("sagging")]] = 1
    general = ringing.freed(PROBLEM, fit)
    assert general.fixed == ()
    assert dict(zip(general.free, general.start, strict=True)) == {
        coordinate("frequency"): 1.7,
        coordinate("damping_ratio"): 0.4,
        coordinate("share", 0): 0.0,
        coordinate("share", 1): 0.0,
        coordinate("share", 3): 1.0,
        coordinate("share", 4): 1.0,
        coordinate("sagging"): 1.0,
    }
    assert ringing.freed(PROBLEM, found(general)) is None
    assert ringing.freed(PROBLEM, found(Hypothesis("low_pass"))) is None


@pytest.mark.parametrize(
    ("hertz", "log_damping", "loss", "plausible"),
    [
        (5.0, 0.3, 90.0, True),
        (3.5, 0.3, 90.0, False),
        (2.0, 0.3, 0.0, False),
        (5.0, MOST_DAMPED, 90.0, False),
        (5.0, MOST_DAMPED, 1.0, True),
    ],
)
def test_what_needs_the_limits_is_no_tool_on_springs(monkeypatch, hertz, log_damping, loss, plausible):
    """Of 100 nats gained, a usual damping loses ``loss`` nats."""
    free = (coordinate("frequency"), coordinate("damping_ratio"))
    best = found(Hypothesis(EFFECT, free, (0.0, 0.0)), frequency=10 / hertz, damping_ratio=log_damping)
    worse = best._replace(log_likelihood=best.log_likelihood - 100)

    def refit(problem, hypotheses, start):
        assert hypotheses[-1].fixed == ((free[1], 0.0),)
        assert hypotheses[-1].free == free[:1]
        return start._replace(log_likelihood=start.log_likelihood - loss)

    monkeypatch.setattr(ringing, "fit", refit)
    assert ringing.is_plausible(PROBLEM, worse, best) is plausible
    assert ringing.is_plausible(PROBLEM, worse, best._replace(hypotheses=(Hypothesis("low_pass"),)))


def test_a_log_on_which_no_spring_gains_still_has_a_start():
    tried = [(-2.0, Hypothesis("tool_flexibility", (0, 1, 2), (3.0, -2.0, 0.4))), (-1.0, Hypothesis("", ()))]
    gain, start = ringing._stiffest(tried)
    assert (gain, start.start) == (-2.0, (3.0, -2.0, 0.4))
