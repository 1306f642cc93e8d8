"""Starting points of the fits of own effects, and the diagnosis of a log with one."""

import jax
import jax.numpy as jnp
import numpy as np
import own_effects
import pytest

from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.diagnosis.diagnose import diagnose
from ftbias_jax.diagnosis.proposals.searched import Extent, apart, starts_of, starts_together
from ftbias_jax.filtering.verbs.from_setup import filter_log
from ftbias_jax.model.effects.catalogue import neutral_values
from ftbias_jax.model.effects.types import Effect, Model, Parameter
from ftbias_jax.model.own_effects import load_effects
from ftbias_jax.model.simulate_log import simulate
from ftbias_jax.setup import parse_setup

MODEL = Model(None, jnp.zeros(3), jnp.ones(10))
SIZE = Parameter("size", "N", "", scale=1.0)


def starts(parameter, *others):
    effect = Effect("own", "sensor", (parameter, *others), "", "", reading=lambda v, s, w: w)
    return np.stack(starts_of(effect, parameter, np.asarray(neutral_values(effect, MODEL)[parameter.name])))


@pytest.mark.parametrize(
    ("least", "most", "first", "last"), [(0.1, 100.0, 0.1, 100.0), (1e-6, 1e6, 0.1, 10.0)], ids=["bounds", "no hint"]
)
def test_a_positive_parameter_is_searched_by_factors_between_its_bounds(least, most, first, last):
    found = starts(Parameter("tau", "s", "", (), least, most, 1.0, 1.0, search=True), SIZE)
    np.testing.assert_allclose(found[[0, -1]], [first, last])
    np.testing.assert_allclose(found[1:] / found[:-1], found[1] / found[0])


def test_stated_starts_are_taken_and_whole_numbers_and_places_searched_within_their_bounds():
    stated = Parameter("place", "m", "", (3,), scale=1.0, search=True, starts=((0, 0, 1), (1, 0, 0)))
    np.testing.assert_array_equal(starts(stated), [[0, 0, 1], [1, 0, 0]])
    joint = Parameter("joint", "1", "", (), 1, 7, 1.0, 0.0, search=True)
    np.testing.assert_array_equal(starts(joint, SIZE), range(1, 8))
    found = starts(Parameter("place", "m", "", (3,), -0.1, 5.0, 0.0, 0.3, search=True), SIZE)
    assert (len(found), found.min(), found.max()) == (7, -0.1, 0.3)


def together(*searched, seconds=40.0):
    """All starts of an effect in a log of this duration, on a straight path of one metre."""
    effect = Effect("own", "sensor", (SIZE, *searched), "", "", reading=lambda v, s, w: w)
    way = np.linspace(0, 1, 101)[:, None] * np.array([[1.0, 0, 0]])
    return starts_together(effect, neutral_values(effect, MODEL), Extent(seconds, apart(way)))


BEGIN, END = (Parameter(name, "s", "", lower=0.0, scale=5.0, search=True) for name in ("begin", "end"))
LENGTH = Parameter("length", "s", "", (), 0.05, 20.0, 1.0, 1.0, search=True)


def test_a_time_that_may_be_as_late_as_the_log_is_tried_all_along_it():
    for searched in ((BEGIN,), (BEGIN, END), (BEGIN, LENGTH)):
        found = together(*searched)
        times = np.unique([start["begin"] for start in found])
        assert len(found) <= 256
        assert len(times) >= 16
        assert 0 < times[0] == pytest.approx(40 - times[-1])
    delay = BEGIN._replace(name="delay", upper=0.5)
    assert max(start["delay"] for start in together(delay)) < 0.5
    stated = together(BEGIN._replace(starts=(3.0, 4.0)))
    np.testing.assert_array_equal([start["begin"] for start in stated], [3, 4])


def test_a_place_is_tried_where_the_sensor_passes_and_around_neutral_within_its_bounds():
    place = Parameter("place", "m", "", (3,), -0.2, 0.7, 0.0, 0.3, search=True)
    tried = np.array([start["place"] for start in together(place)])
    passed = tried[(tried[:, 1:] == 0).all(1)]
    assert tried.max() <= 0.7
    assert np.diff(np.sort(passed[:, 0])).max() < 0.25
    assert {(0.0, 0.3, 0.0), (0.0, 0.0, -0.2)} <= set(map(tuple, tried))
    np.testing.assert_allclose(apart(np.linspace(0, 1, 101)[:, None] * np.eye(3)[:1])[:3, 0], [0.5, 0, 1], atol=1e-12)


@pytest.fixture(scope="module")
def hose(tmp_path_factory):
    path = tmp_path_factory.mktemp("own") / "hose.py"
    path.write_text(own_effects.HOSE)
    return load_effects(path)


@pytest.fixture(scope="module")
def dragged(hose):
    return simulate(parse_setup(SETUP), {"hose_drag": {"coefficient": 4.0}}, own=hose, duration=20, rate=100, seed=1)


def pressed(values, signals, wrench):
    begun = jax.nn.sigmoid((signals.t - values["begin"]) / 0.2)
    return wrench + begun[:, None] * jnp.concatenate([values["force"], jnp.zeros(3)])[None]


PRESSED = Effect(
    "pressed",
    "tool",
    (
        Parameter("force", "N", "from then on, sensor frame", (3,), scale=1.0),
        Parameter("begin", "s", "when it begins", lower=0.0, scale=10.0, search=True),
    ),
    "something presses from a time on",
    "look",
    reading=pressed,
)


@pytest.mark.parametrize(
    ("force", "begin"), [((0.0, 0.0, 1.5), 4.321), pytest.param((0.5, -0.4, 0.3), 17.7, marks=pytest.mark.slow)]
)
def test_an_own_effect_that_begins_at_a_time_is_found_wherever_that_is(force, begin):
    """The log has the same shape as that of the hose."""
    made = simulate(
        parse_setup(SETUP), {"pressed": {"force": force, "begin": begin}}, own=[PRESSED], duration=20, rate=100, seed=2
    )
    (cause,) = diagnose(made.setup, [made.log], effects=[PRESSED]).causes
    assert cause.effect == "pressed"
    np.testing.assert_array_less(
        np.abs(np.subtract(cause.parameters["force"], force)), 4 * np.array(cause.stderr["force"])
    )
    assert abs(cause.parameters["begin"] - begin) < 4 * cause.stderr["begin"] < 0.4


def held(values, signals, wrench):
    on = (signals.t > values["begin"]) & (signals.t < values["begin"] + values["length"])
    return wrench + signals.push(on[:, None] * values["force"][None])


HELD = PRESSED._replace(name="held", stage="environment", parameters=(*PRESSED.parameters, LENGTH), reading=held)


def test_an_own_effect_that_lasts_a_while_is_found_with_its_beginning_and_length():
    """It is switched between two samples, so no derivative determines its times."""
    true = {"force": [1.0, -0.6, 0.8], "begin": 6.543, "length": 2.345}
    made = simulate(parse_setup(SETUP), {"held": true}, own=[HELD], duration=20, rate=100, seed=3)
    diagnosis = diagnose(made.setup, [made.log], effects=[HELD])
    (cause,) = diagnosis.causes
    assert (diagnosis.verdict, cause.effect) == ("explained", "held")
    for name, value in true.items():
        np.testing.assert_allclose(cause.parameters[name], value, atol=0.05)


@pytest.fixture(scope="module")
def diagnosis(dragged, hose):
    return diagnose(dragged.setup, [dragged.log], effects=hose)


def test_an_own_effect_is_named_with_its_parameter(diagnosis):
    (cause,) = diagnosis.causes
    assert (diagnosis.verdict, cause.effect, cause.stage) == ("explained", "hose_drag", "environment")
    assert abs(cause.parameters["coefficient"] - 4.0) < 3 * cause.stderr["coefficient"] < 0.6
    assert diagnosis.candidates[0].effect == "hose_drag"
    for words in ("A hose drags at the tool", "N s/m", "what to do: route the hose so that it moves freely"):
        assert words in str(diagnosis)


@pytest.mark.slow
def test_the_setup_that_is_made_filters_it_away(diagnosis, dragged, hose, tmp_path):
    fixed = diagnosis.apply(dragged.setup)
    fixed.save(tmp_path / "fixed.toml")
    assert "[effects.hose_drag]" in (tmp_path / "fixed.toml").read_text()
    before, after = (
        np.abs(filter_log(setup, dragged.log).bias - dragged.truth.bias).mean(0) for setup in (dragged.setup, fixed)
    )
    assert (after[:3] < before[:3] / 3).all()
