"""An entry that is deleted from the catalogue and passed as an own effect gives the same diagnosis."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.diagnosis.diagnose import diagnose
from ftbias_jax.diagnosis.hypothesis import movable
from ftbias_jax.diagnosis.proposals import starts
from ftbias_jax.diagnosis.regression.coordinates import layout
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.model.own_effects import catalogue_with, load_effects

AMPLITUDE = jnp.array([1.5, -1.0, 2.0, 0.05, 0.1, -0.08])
JOINTS = 7


@pytest.fixture
def hand_in(monkeypatch, tmp_path):
    """Delete an entry, and return the catalogue with that entry as a user's file adds it."""

    def hand_in(name):
        entry = CATALOGUE[name]
        # In a table of its own: the order of the entries is the order in which they act, also after this test.
        monkeypatch.setattr(CATALOGUE, "_entries", {other: CATALOGUE[other] for other in CATALOGUE if other != name})
        monkeypatch.setattr(starts, "ENTRY", entry, raising=False)
        file = tmp_path / "mine.py"
        file.write_text("from ftbias_jax.diagnosis.proposals import starts\nEFFECTS = [starts.ENTRY]\n")
        return catalogue_with(load_effects(file))

    return hand_in


@pytest.mark.parametrize("name", list(CATALOGUE))
def test_an_entry_that_is_handed_in_is_fitted_and_searched_as_before(name, hand_in):
    entry, every = CATALOGUE[name], dict(CATALOGUE)
    searches = {type(one.fit.search) for one in every.values()}
    before = {kind: {one.name for one in CATALOGUE.searched_by(kind)} for kind in searches}
    built_in = _coordinates(name, CATALOGUE)
    catalogue = hand_in(name)
    assert name not in CATALOGUE
    assert dict(catalogue) == every
    assert catalogue[name] is entry
    assert {kind: {one.name for one in catalogue.searched_by(kind)} for kind in searches} == before
    for mine, its in zip(_coordinates(name, catalogue), built_in, strict=True):
        np.testing.assert_equal(mine, its)


def _coordinates(name, catalogue):
    """Name, bounds of the coordinates and fitted ones of each parameter of an effect, counted from the first."""
    whole = layout(JOINTS, catalogue)
    free = movable(SimpleNamespace(layout=whole), catalogue[name])
    slices = [(parameter, s) for (effect, parameter), s in whole.slices.items() if effect == name]
    return [
        (parameter, whole.least[s], whole.most[s], [i - s.start for i in free if s.start <= i < s.stop])
        for parameter, s in slices
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("tool_mass", {"mass": jnp.array(0.96)}),
        ("encoder_offset", {"joint": jnp.array(2.0), "offset": jnp.array(0.02)}),
        ("time_delay", {"delay": jnp.array(0.04)}),
        ("warmup", {"amplitude": AMPLITUDE, "tau": jnp.array(6.0)}),
        ("bias_jump", {"amplitude": AMPLITUDE, "time": jnp.array(8.0), "ramp": jnp.array(0.0)}),
        ("outliers", {"rate": jnp.array(0.01), "size": 5.0 * jnp.abs(AMPLITUDE)}),
    ],
)
def test_an_entry_that_is_handed_in_gives_the_same_diagnosis(setup, record, monkeypatch, name, values):
    log, entry = record({name: values}), CATALOGUE[name]
    built_in = diagnose(setup, [log], ["log"])
    # In a table of its own: the order of the entries is the order in which they act, also after this test.
    monkeypatch.setattr(CATALOGUE, "_entries", {other: CATALOGUE[other] for other in CATALOGUE if other != name})
    assert name not in CATALOGUE
    handed_in = diagnose(setup, [log], ["log"], effects=[entry])
    assert [cause.effect for cause in built_in.causes] == [name]
    assert handed_in.verdict == built_in.verdict
    for mine, its in zip(handed_in.causes, built_in.causes, strict=True):
        assert mine.effect == its.effect
        assert mine.indistinguishable_from == its.indistinguishable_from
        assert mine.separate_by == its.separate_by
        assert mine.shrink == pytest.approx(its.shrink, abs=0.01)
        for parameter, value in its.parameters.items():
            error = np.asarray(its.stderr[parameter]) + 1e-6
            np.testing.assert_array_less(np.abs(np.subtract(mine.parameters[parameter], value)) / error, 0.05)
    assert [one.effect for one in handed_in.candidates[:3]] == [one.effect for one in built_in.candidates[:3]]
