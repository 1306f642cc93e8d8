"""Every fault of an own effect is reported in one sentence, and a correct effect passes."""

import jax
import jax.numpy as jnp
import numpy as np
import own_effects
import pytest

import ftbias_jax as ft
from ftbias_jax.diagnosis.check_effects import check_effects, typed_errors
from ftbias_jax.model.effects.catalogue import CATALOGUE
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


def for_a_while(values, signals, wrench):
    on = (signals.t > values["begin"]) & (signals.t < values["end"])
    return wrench + values["size"] * on[:, None]


def there(values, signals, wrench):
    away = signals.path.position - values["place"][None]
    near = jnp.exp(-((away / values["width"]) ** 2).sum(1, keepdims=True))
    return wrench + values["size"] * near


PLACE = Parameter("place", "m", "where it acts", (3,), -2, 2, scale=0.2, search=True)
JOINT = Parameter("joint", "1", "whose", (), 1, 7, 1.0, 0.0, search=True)


@pytest.mark.parametrize(
    ("effect", "fault"),
    [
        (entry(lambda v, s, w: w[:, :3] * v["size"]), "returns the shape (400, 3)"),
        (entry(lambda v, s, w: None), "returns NoneType"),
        (entry(lambda v, s, w: w * v["other"]), "raises KeyError: 'other'"),
        (entry(lambda v, s, w: w + v["size"] + 1), "at neutral it changes the reading by 1"),
        (
            entry(lambda v, s, w: w + v["size"] * jnp.sqrt(s.t - 100)[:, None]),
            "at neutral the reading is NaN or infinite",
        ),
        (entry(lambda v, s, w: w + jnp.log(v["size"]) * 0), "at neutral the reading is NaN or infinite"),
        (
            entry(lambda v, s, w: w + jnp.sqrt(v["size"]), SIZE._replace(lower=0)),
            "size: its derivative of the reading is not finite",
        ),
        (entry(lambda v, s, w: w + v["size"] if v["size"] > 0 else w), "use jnp.where instead of if"),
        (entry(lambda v, s, w: w + np.sin(v["size"])), "jnp instead of numpy"),
        (entry(lambda v, s, w: w + jnp.floor(v["size"] / 3e-5)), "size: the reading is not differentiable by it"),
        (entry(lambda v, s, w: w + v["size"] ** 2), "size: at neutral the reading does not depend on it"),
        (entry(lambda v, s, w: w), "typical values (neutral plus scale) change nothing"),
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
        entry(from_then_on, SIZE, BEGIN),
        entry(for_a_while, SIZE, BEGIN._replace(lower=0.0), BEGIN._replace(name="end", lower=0.0)),
        entry(there, SIZE, PLACE, TEMPO._replace(name="width", unit="m", lower=0.02, upper=1.0, neutral=0.1)),
        entry(lambda v, s, w: w + v["size"] * (v["joint"] == 6) * s.q[:, 5, None], SIZE, JOINT),
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


def test_a_diagnosis_that_fails_by_an_own_effect_names_it(setup, record):
    """Whatever the caller's code raises, the error is one line that says which effect it was."""
    broken = entry(lambda v, s, w: w + v["strenght"])
    with pytest.raises(ft.UsageError, match=r"effects: effect 'own': its code raises KeyError"):
        ft.diagnose(setup, record(None), effects=[broken], unchecked=True)
    with pytest.raises(ZeroDivisionError), typed_errors(()):
        1 / 0  # noqa: B018


def test_an_own_effect_that_is_never_finite_is_told_by_a_diagnosis_because_no_fit_would_notice():
    nowhere = entry(lambda v, s, w: w + v["size"] * jnp.nan)
    with pytest.raises(ft.UsageError, match=r"effects: effect 'own': .*the reading is NaN"), typed_errors([nowhere]):
        pass
