"""An entry of the catalogue that is deleted and handed in as an effect of one's own gives the same diagnosis."""

import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.diagnosis.diagnose import diagnose
from ftbias_jax.model.effects.catalogue import CATALOGUE

AMPLITUDE = jnp.array([1.5, -1.0, 2.0, 0.05, 0.1, -0.08])


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
