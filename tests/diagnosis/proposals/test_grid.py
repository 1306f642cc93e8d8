"""Starting points of effects by the searches that their entries choose."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.diagnosis.proposals.starts import grid_hypotheses, smooth_hypotheses
from ftbias_jax.diagnosis.regression.coordinates import layout
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.model.effects.fitting import Fitting, Grid, Linear
from ftbias_jax.model.effects.types import Effect, Model, Parameter
from ftbias_jax.model.own_effects import catalogue_with

MODEL = Model(SimpleNamespace(linear=np.zeros((7, 3))), jnp.array([0, 0, -9.81]), jnp.ones(10))


def problem_of(*own):
    signals = SimpleNamespace(model=MODEL)
    catalogue, parts = catalogue_with(own), [SimpleNamespace(signals=signals)]
    return SimpleNamespace(layout=layout(7, catalogue), catalogue=catalogue, parts=parts)


def own(fit, *parameters):
    return Effect("own", "sensor", parameters, "", "", reading=lambda v, s, w: w, fit=fit)


def test_each_joint_and_each_variant_is_a_hypothesis():
    problem = problem_of()
    found = smooth_hypotheses(problem, ())
    joints = [h for h in found if h.effect == "encoder_offset"]
    assert [h.detail for h in joints] == list(range(1, 8))
    assert len({h.free for h in joints}) == len({h.group for h in joints}) == 7
    stays, turns = (h for h in found if h.effect == "mount_rotation")
    place = layout(7).slices["mount_rotation", "tool_turns"].start
    assert (stays.fixed, turns.fixed) == ((), ((place, 1.0),))
    (matrix,) = (h for h in found if h.effect == "crosstalk")
    assert len(matrix.free) == 30  # the diagonal has no scale, so it is not fitted


def test_what_is_taken_is_not_proposed():
    names = {h.effect for h in smooth_hypotheses(problem_of(), ("gain", "crosstalk"))}
    assert not names & {"gain", "crosstalk"}
    assert "tool_mass" in names


def test_an_effect_of_ones_own_may_pick_any_of_them():
    size = Parameter("size", "N", "", scale=2.0)
    on = Parameter("on", "1", "", (), 0, 1, 0.0, 0.0, optional=True)
    linear = own(Fitting(Linear(((), (("on", 1.0),)))), size, on)
    assert len([h for h in smooth_hypotheses(problem_of(linear), ()) if h.effect == "own"]) == 2
    lag, wide = (Parameter(name, "s", "", (), 0.0, 10.0, 0.0, 0.1, starts=(0.1, 0.5)) for name in ("lag", "wide"))
    grid = own(Fitting(Grid()), lag, wide)
    starts = [h.start for h in grid_hypotheses(problem_of(grid), np.ones(6), ()) if h.effect == "own"]
    np.testing.assert_allclose(starts, [(1, 1), (1, 5), (5, 1), (5, 5)])


@pytest.mark.parametrize(("effect", "start"), [("time_delay", 5.0), ("low_pass", 2 * np.pi * 0.02 * 10)])
def test_a_start_is_where_its_entry_says(effect, start):
    """A delay of half a tenth of a second, and a filter of 20 ms, in coordinates."""
    found = [h for h in grid_hypotheses(problem_of(), np.ones(6), ()) if h.effect == effect]
    assert [h.start for h in found if h.group == found[0].group][1] == pytest.approx((start,))


def test_what_has_no_scale_keeps_its_start_and_the_best_of_each_is_fitted():
    found = [h for h in grid_hypotheses(problem_of(), np.ones(6), ()) if h.effect == "low_pass"]
    assert {len(h.free) for h in found} == {1}
    assert len({h.group for h in found}) == len({h.fixed for h in found}) == 2, "filters of either order"


def test_loops_begin_at_shares_of_the_load():
    span = np.array([1.0, 2, 3, 4, 5, 6])
    first = next(h for h in grid_hypotheses(problem_of(), span, ()) if h.effect == "hysteresis")
    scale = np.asarray(CATALOGUE["hysteresis"].parameters[0].scale)
    np.testing.assert_allclose(np.array(first.start) * scale, 0.01 * span)
