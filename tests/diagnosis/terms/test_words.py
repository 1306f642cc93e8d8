"""Terms in words and numbers: units of every form, and names that programs can read."""

from dataclasses import replace

import numpy as np
import pytest

from ftbias_jax.diagnosis.terms.found import coefficients_of, grouped, sentence
from ftbias_jax.diagnosis.terms.grid import make_term
from ftbias_jax.diagnosis.terms.phrases import DRIVE_WORDS, FORM_WORDS, check, resembles
from ftbias_jax.model.effects.terms.columns import count_columns
from ftbias_jax.model.effects.terms.forms import DRIVES, FORMS


def test_every_drive_and_every_form_has_words():
    assert DRIVE_WORDS.keys() == set(DRIVES)
    assert FORM_WORDS.keys() == FORMS.keys()


@pytest.mark.parametrize(("hertz", "kind"), [(50.0, "mains"), (5.8, "a fan"), (0.5, "a fan"), (0.07, "a regulator")])
def test_slow_lines_are_no_mains_hum(hertz, kind):
    term = make_term("frequency", "line", "sensor", "wrench", 0, {"frequency": np.asarray(hertz)})
    assert resembles(term, np.zeros(1))[0].startswith(kind)
    assert ("a structure that rings" in resembles(term, np.zeros(1))) is (hertz > 2)


@pytest.mark.parametrize(
    ("times", "advice"), [([3.0], "weigh the tool"), ([3.0, 4.0], "look at what touched the tool")]
)
def test_a_step_that_ends_is_something_that_touched_the_tool(times, advice):
    term = make_term("time", "step", "sensor", "wrench", 0, {"time": np.array(times)})
    assert check(term, np.zeros(1)).startswith(advice)
    assert ("something that touches the tool" in resembles(term, np.zeros(1))) is (len(times) > 1)


@pytest.mark.parametrize("key", FORMS, ids=" ".join)
@pytest.mark.parametrize(("frame", "acts_as"), [("base", "force"), ("base", "wrench"), ("sensor", "wrench")])
def test_every_coefficient_has_a_unit_and_a_place(key, frame, acts_as):
    form = FORMS[key]
    if (form.kind == "vectors") and acts_as == "wrench":
        pytest.skip("vectors act along themselves")
    numbers = {parameter.name: 0.7 for parameter in form.parameters}
    term = make_term(*key, "sensor" if form.kind == "channels" else frame, acts_as, 2, numbers)
    count = count_columns(term)
    assert len(coefficients_of(term)) == count
    assert all(coefficient.unit for coefficient in coefficients_of(term))
    found = grouped(term, np.arange(1.0, count + 1))
    assert sum(np.size(values) for values in found.values()) == count
    if acts_as != "noise" and key[0] != "noise":
        assert sentence(term, np.ones(count), 0.1 * np.ones(count), 0.5).endswith("(50 % of the gap)")


@pytest.mark.parametrize(
    ("key", "acts_as", "unit"),
    [
        (("velocity", "linear"), "force", "N_per_m_s"),
        (("velocity", "quadratic"), "force", "N_per_m2_s2"),
        (("angular_velocity", "linear"), "torque", "Nm_per_rad_s"),
        (("constant", "steady"), "force", "N"),
        (("joint_velocity", "quadratic"), "force", "N_per_rad2_s2"),
    ],
)
def test_names_of_coefficients_are_their_units(key, acts_as, unit):
    term = make_term(*key, "base", acts_as)
    assert list(grouped(term, np.ones(count_columns(term)))) == [unit]


@pytest.mark.parametrize(
    ("key", "units"),
    [
        (("load", "square"), ["N_per_N2", "Nm_per_Nm2"]),
        (("load", "cube"), ["N_per_N3", "Nm_per_Nm3"]),
        (("load", "size"), ["N_per_N", "Nm_per_Nm"]),
        (("load_time", "linear"), ["N_per_N_s", "Nm_per_Nm_s"]),
        (("load_time", "step"), ["N_per_N", "Nm_per_Nm"]),
        (("temperature", "sensitivity"), ["N_per_N_K", "Nm_per_Nm_K"]),
        (("noise", "load"), ["N2_per_N2", "Nm2_per_Nm2"]),
        (("noise", "speed"), ["N2_per_m2_s2", "Nm2_per_m2_s2"]),
        (("noise", "acceleration"), ["N2_per_m2_s4", "Nm2_per_m2_s4"]),
    ],
)
def test_forces_and_torques_have_units_of_their_own(key, units):
    numbers = {parameter.name: 0.7 for parameter in FORMS[key].parameters}
    term = make_term(*key, "sensor", "wrench", 0, numbers)
    found = grouped(term, np.arange(6.0))
    assert found == {units[0]: [0.0, 1.0, 2.0], units[1]: [3.0, 4.0, 5.0]}


def test_the_sentence_says_how_much_of_what_where():
    text = sentence(make_term("velocity", "linear", "base", "force"), np.array([23.6]), np.array([0.4]), 0.92)
    assert text == "a force of 23.60 +- 0.40 N per m/s against the velocity of the tool, in base axes (92 % of the gap)"


@pytest.mark.parametrize("coefficients", [[1.2], [-1.2], [1.2, 0.1, 0.2]])
def test_inertia_without_weight_may_be_a_payload_that_the_controller_subtracts(coefficients):
    frame = "base" if len(coefficients) == 1 else "sensor"
    term = replace(make_term("acceleration", "linear", frame, "force"), coefficients=np.array(coefficients))
    is_mass = coefficients == [1.2]
    assert resembles(term, np.zeros(3))[0].startswith("a controller that subtracts" if is_mass else "entrained air")
    assert check(term, np.zeros(3)).startswith("set the controller's payload" if is_mass else "tap the tool")
