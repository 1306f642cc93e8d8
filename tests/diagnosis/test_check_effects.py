"""Every fault of an own effect is told in a sentence, and an effect in order passes."""

import jax
import jax.numpy as jnp
import numpy as np
import own_effects
import pytest

from ftbias_jax.diagnosis.check_effects import check_effects
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.model.effects.fitting import Fitting, Starts
from ftbias_jax.model.effects.types import Effect, Parameter, Twin
from ftbias_jax.model.own_effects import load_effects

SIZE = Parameter("size", "N", "of the change", scale=1.0)
TEMPO = Parameter("tempo", "Hz", "of the change", (), 0.1, 10.0, 1.0, 1.0, search=True)


BEGIN = Parameter("begin", "s", "when it begins", scale=1.0, search=True)


def entry(reading, *parameters, **more):
    return Effect("own", "environment", parameters or (SIZE,), "it changes", "mend it", reading=reading, **more)


def from_then_on(values, signals, wrench):
    begun = jax.nn.sigmoid((signals.t - values["begin"]) / 0.3)
    return wrench + values["size"] * begun[:, None]


@pytest.mark.parametrize(
    ("effect", "fault"),
    [
        (entry(lambda v, s, w: w[:, :3] * v["size"]), "returns the shape (400, 3)"),
        (entry(lambda v, s, w: None), "returns NoneType"),
        (entry(lambda v, s, w: w * v["other"]), "raises KeyError: 'other'"),
        (entry(lambda v, s, w: w + v["size"] + 1), "at neutral it changes the reading by 1"),
        (entry(lambda v, s, w: w + v["size"] * jnp.sqrt(s.t - 100)[:, None]), "at neutral the reading is no number"),
        (entry(lambda v, s, w: w + jnp.log(v["size"]) * 0), "at neutral the reading is no number"),
        (
            entry(lambda v, s, w: w + jnp.sqrt(v["size"]), SIZE._replace(lower=0)),
            "size: the reading cannot be differentiated",
        ),
        (entry(lambda v, s, w: w + v["size"] if v["size"] > 0 else w), "use jnp.where instead of if"),
        (entry(lambda v, s, w: w + np.sin(v["size"])), "jnp instead of numpy"),
        (entry(lambda v, s, w: w + jnp.floor(v["size"] / 3e-5)), "size: the reading is not differentiable by it"),
        (entry(lambda v, s, w: w + v["size"] ** 2), "size: at neutral the reading does not depend on it"),
        (entry(lambda v, s, w: w), "typical values (neutral plus scale) change nothing"),
        (entry(from_then_on, SIZE, BEGIN._replace(scale=0.0), fit=Fitting(Starts("size"))), "the time 'size' must be"),
        (entry(lambda v, s, w: w + v["size"], twins=(Twin("hose", False, "?"),)), "its twin 'hose' is no effect"),
        (
            entry(lambda v, s, w: w + v["size"] + jnp.sin(v["tempo"]) - jnp.sin(1.0), SIZE, TEMPO),
            "switched off, at a start of its search it changes the reading",
        ),
        (
            Effect("own", "tool", (SIZE,), "", "", transform=lambda v, s: s.model),
            "its transform returns Model",
        ),
        (
            Effect("own", "timing", (SIZE,), "", "", recording=lambda v, k, r: r._replace(wrench=r.wrench + 1)),
            "at neutral it changes samples",
        ),
    ],
)
def test_a_fault_is_told(effect, fault):
    (told,) = check_effects([effect])
    assert told.startswith("effect 'own': ")
    assert fault in told


@pytest.mark.parametrize(
    "effect",
    [
        entry(lambda v, s, w: w + v["size"]),
        entry(lambda v, s, w: w + v["size"], SIZE._replace(lower=0)),
        entry(lambda v, s, w: w + v["size"] * jnp.sin(v["tempo"] * s.t)[:, None], SIZE, TEMPO),
        entry(from_then_on, SIZE, BEGIN._replace(starts=(5.0, 15.0, 25.0, 35.0))),
        entry(from_then_on, SIZE, BEGIN, fit=Fitting(Starts(when="begin"))),
        Effect("own", "kinematics", (SIZE,), "", "", transform=lambda v, s: s._replace(q=s.q + v["size"])),
        Effect("own", "timing", (SIZE,), "", "", recording=lambda v, k, r: r._replace(wrench=r.wrench + v["size"])),
    ],
)
def test_an_effect_in_order_passes(effect):
    assert check_effects([effect]) == []


def test_what_is_no_effect_and_two_of_one_name_are_told():
    assert check_effects(["hose"]) == ["expected an Effect, got str"]
    one = entry(lambda v, s, w: w + v["size"])
    assert check_effects([one, one._replace()]) == ["effect 'own': the name is taken; choose another one"]


def test_the_effect_of_the_how_to_page_is_in_order(tmp_path):
    path = tmp_path / "hose.py"
    path.write_text(own_effects.HOSE)
    assert check_effects(load_effects(path)) == []


@pytest.mark.parametrize("name", ["gain", "tool_mass", "time_delay", "gravity_tilt", "crosstalk"])
def test_smooth_effects_of_the_catalogue_would_pass_under_another_name(name):
    assert check_effects([CATALOGUE[name]._replace(name="own")]) == []
