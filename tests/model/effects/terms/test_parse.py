"""The sections [[effects.term]] are read, refused with field and remedy, and written back."""

import numpy as np
import pytest

from ftbias_jax.errors import SetupError
from ftbias_jax.model.effects.catalogue import values_from_setup
from ftbias_jax.model.effects.terms.parse import flat_numbers, parse_terms, section_of

DRAG = {
    "drive": "velocity",
    "form": "linear",
    "frame": "base",
    "acts_as": "force",
    "point": [0, 0, 0.1],
    "coefficients": [6.0],
}
HEAT = {
    "drive": "joint_velocity",
    "form": "heat",
    "frame": "sensor",
    "acts_as": "bias",
    "time_constant": 15.0,
    "columns": [0, 2],
    "coefficients": [0.3, -0.1],
}


LOAD = DRAG | {"drive": "acceleration", "form": "payload", "time": [3.0, 8.5], "takes": 0.05}


def test_sections_are_read_and_written_back():
    terms = parse_terms([DRAG, HEAT, LOAD, LOAD | {"time": 3.0}])
    assert [section_of(term) for term in terms.values()] == [DRAG, HEAT, LOAD, LOAD | {"time": 3.0}]


@pytest.mark.parametrize(("times", "words"), [([8.5, 3.0], "ascending"), ([-1.0, 3.0], "from 0"), ([], "1 number or")])
def test_times_of_switching_are_checked(times, words):
    with pytest.raises(SetupError, match=r"term\[1\]\.time") as caught:
        parse_terms([LOAD | {"time": times}])
    assert words in str(caught.value)


def test_numbers_of_terms_have_names():
    terms = parse_terms([DRAG, HEAT])
    assert flat_numbers(terms).keys() == {
        "1.coefficients",
        "1.point",
        "2.coefficients",
        "2.point",
        "2.time_constant",
    }


def test_terms_stand_beside_effects_of_the_catalogue():
    values = values_from_setup({"tool_mass": {"mass": 1.0}, "term": [DRAG]})
    assert values.keys() == {"tool_mass", "term"}
    np.testing.assert_array_equal(values["term"]["1"].coefficients, [6.0])


@pytest.mark.parametrize(
    ("change", "field", "words"),
    [
        ({"drive": "velocty"}, "term[1].drive", "velocity"),
        ({"form": "quadratc"}, "term[1].form", "quadratic"),
        ({"frame": "wrist"}, "term[1].frame", "base"),
        ({"coefficients": [1.0, 2.0]}, "term[1].coefficients", "give 1 number"),
        ({"coefficients": ["a"]}, "term[1].coefficients", "give 1 number"),
        ({"speed": 0.1}, "term[1].speed", "unknown key"),
        ({"columns": [3]}, "term[1].columns", "0 to 0"),
        ({"drive": "joint_velocity", "form": "viscous"}, "term[1].joint", "number of a joint"),
        ({"drive": "joint_velocity", "form": "friction", "joint": 1, "speed": -1.0}, "term[1].speed", "from"),
    ],
)
def test_what_cannot_be_is_refused_with_field_and_remedy(change, field, words):
    with pytest.raises(SetupError) as caught:
        parse_terms([{**DRAG, **change}])
    assert field in str(caught.value)
    assert words in str(caught.value)


def test_a_single_table_is_no_list_of_terms():
    with pytest.raises(SetupError, match=r"\[\[effects.term\]\]"):
        parse_terms(DRAG)
