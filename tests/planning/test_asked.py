import jax
import jax.numpy as jnp
import numpy as np
import pytest
from two_joints import SETUP

from ftbias_jax.calibration.tool.physical import NAMES
from ftbias_jax.errors import UsageError
from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.model.effects.types import Model, Signals
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.planning.asked import _rows, asked_for, columns, inertia_std, reading
from ftbias_jax.setup import parse_setup

PARAMS = params_from_setup(parse_setup(SETUP))
MODEL = Model(PARAMS.arm, PARAMS.gravity, PARAMS.theta)


def signals(count=30):
    t = np.linspace(0, 3, count)
    phase = t[:, None] * [2.0, 3.0] + [0.0, 1.0]
    q, dq, ddq = np.sin(phase), [2.0, 3.0] * np.cos(phase), [-4.0, -9.0] * np.sin(phase)
    return Signals(*map(jnp.asarray, (t, q, dq, ddq, np.zeros(count))), MODEL)


@pytest.mark.parametrize("name", ["tool", "gain", "encoder_offset", "low_pass"])
def test_columns_are_differences_of_readings(name):
    asked = asked_for(name, MODEL, CATALOGUE, {})
    numbers = (tuple(jnp.asarray(x) for x in (asked.base, asked.scale, asked.at)),)
    found = np.asarray(jax.jit(lambda s, x: columns(s, {}, x, (name,), CATALOGUE))(signals(), numbers))
    read = jax.jit(lambda s, x: reading(s, {}, numbers[0][0], x, name, CATALOGUE))
    assert len(found) == len(asked.at) == len(asked.labels) == len(asked.units)
    for i, column in enumerate(found):
        step = 1e-5 * asked.scale[i] * np.eye(len(asked.at))[i]
        either = [read(signals(), jnp.asarray(asked.at + s)) for s in (step, -step)]
        difference = np.asarray(either[0] - either[1]) / (2 * step[i])
        np.testing.assert_allclose(column, difference, atol=1e-5 * max(np.abs(difference).max(), 1e-3 / asked.scale[i]))


def test_the_tool_is_asked_for_as_its_data_sheet_and_read_as_the_nominal_model():
    asked = asked_for("tool", MODEL, CATALOGUE, {})
    assert asked.labels == NAMES
    found = reading(signals(), {}, jnp.zeros(0), jnp.asarray(asked.at), "tool", CATALOGUE)
    np.testing.assert_allclose(found, compose.predict(signals(), {}), atol=1e-9)


def test_an_offset_is_asked_for_at_every_joint():
    asked = asked_for("encoder_offset", MODEL, CATALOGUE, {"encoder_offset": {"joint": 2.0, "offset": 0.03}})
    assert asked.labels == ("offset_1", "offset_2")
    np.testing.assert_allclose(asked.at, [0, 0.03])
    effect = CATALOGUE["encoder_offset"]
    names = [name for name, _, _ in _rows(effect, effect.parameters[1], np.zeros(6))]
    assert names == [f"offset_{joint}" for joint in range(1, 7)]  # six joints are not the six axes of a wrench


def test_values_that_are_known_take_the_place_of_typical_ones():
    asked = asked_for("tool_mass", MODEL, CATALOGUE, {"tool_mass": {"mass": 1.23}})
    assert asked.at == pytest.approx([1.23])


def test_of_two_effects_there_is_what_each_has_beyond_the_other_and_what_that_can_do():
    one, two = (asked_for(name, MODEL, CATALOGUE, {}) for name in ("tool_mass", "gain"))
    near = [jnp.asarray(x) for x in (one.at * 1.1, np.full(6, 1.02))]
    numbers = [(*map(jnp.asarray, (a.base, a.scale, a.at)), x) for a, x in zip((one, two), near, strict=True)]
    both = (*numbers, 1e-3 * jnp.arange(1.0, 7.0))
    found = np.asarray(jax.jit(lambda s, x: columns(s, {}, x, ("tool_mass", "gain"), CATALOGUE))(signals(), both))
    assert len(found) == 1 + 6 + 1 + 1 + 6
    tool = asked_for("tool", MODEL, CATALOGUE, {})
    inertia = jax.jit(lambda s, x: columns(s, {}, ((tool.base, tool.scale, x),), ("tool",), CATALOGUE))(
        signals(), jnp.asarray(tool.at)
    )
    np.testing.assert_allclose(found[-6:], inertia[4:] * 1e-3 * np.arange(1, 7)[:, None, None], atol=1e-12)
    heavier, scaled = (
        compose.predict(signals(), v)
        for v in ({"tool_mass": {"mass": jnp.asarray(one.at[0])}}, {"gain": {"gain": near[1]}})
    )
    np.testing.assert_allclose(found[0], heavier - scaled, atol=1e-12)
    slopes = jax.jit(lambda s: columns(s, {}, ((*numbers[1][:2], near[1]),), ("gain",), CATALOGUE))(signals())
    np.testing.assert_allclose(found[1:7], slopes, atol=1e-12)


@pytest.mark.parametrize(("names", "known"), [(("gain", "tool_mass"), False), (("tool_inertia", "cable"), True)])
def test_the_inertia_is_not_taken_for_known_unless_it_is_what_an_effect_is_about(names, known):
    std = inertia_std([asked_for(name, MODEL, CATALOGUE, {}) for name in names], MODEL, CATALOGUE)
    assert (std == 0).all() == known
    assert (std < 1e-2).all()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("outliers", "outliers: it is read off single samples"),
        ("tool_mas", "did you mean 'tool_mass'"),
        ("contact", "contact: it happens"),
    ],
)
def test_what_no_motion_shows_is_refused(name, words):
    with pytest.raises(UsageError, match=words):
        asked_for(name, MODEL, CATALOGUE, {})
