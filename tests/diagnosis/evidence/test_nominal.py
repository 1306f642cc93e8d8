from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.diagnosis.evidence import causes
from ftbias_jax.diagnosis.evidence.estimates import with_nominal
from ftbias_jax.diagnosis.report.html import to_html
from ftbias_jax.diagnosis.report.tables import to_table
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.model.wrench.tool_wrench import Model, tool_parameters
from ftbias_jax.runtime.jax_config import in_float64


def problem(known=None, theta=None):
    if theta is None:
        theta = tool_parameters(jnp.asarray(0.73), jnp.array([0.0, 0.01, 0.06]), jnp.array([2e-3, 0, 0, 2e-3, 0, 1e-3]))
    model = Model(arm=None, theta=theta, gravity=jnp.array([0.0, 0.0, -9.81]))
    part = SimpleNamespace(signals=SimpleNamespace(model=model))
    return SimpleNamespace(catalogue=CATALOGUE, known=known or {}, parts=[part])


@pytest.mark.parametrize(
    ("effect", "nominal"),
    [
        ("tool_mass", {"mass": 0.73}),
        ("tool_com", {"center_of_mass": [0.0, 0.01, 0.06]}),
        ("gravity_tilt", {"gravity": [0.0, 0.0, -9.81]}),
        ("gain", {}),
        ("contact", {}),
        ("cable", {}),
        ("an effect that is not in it", {}),
    ],
)
def test_what_the_setup_states_stands_beside_what_was_found(make_candidate, effect, nominal):
    of_others = {
        "contact": {"start": [1.0], "end": [2.0], "force": [[0.0, 0.0, 5.0]]},
        "cable": {"stiffness": 20.0, "link": 5.0, "attachment": [0.0, 0.0, 0.1]},  # their defaults are nobody's word
    }
    parameters = of_others.get(effect, nominal or {"gain": [1.02] * 6})
    found = with_nominal(problem(), make_candidate(effect, parameters=parameters)).nominal
    assert found.keys() == nominal.keys()
    for name, value in nominal.items():
        assert found[name] == pytest.approx(value, abs=1e-6)


def test_an_effect_that_the_setup_has_already_is_shown_with_its_values(make_candidate):
    known = {"gain": {"gain": jnp.full(6, 1.02)}}
    assert with_nominal(problem(known), make_candidate("gain", parameters={"gain": [1.1] * 6})).nominal[
        "gain"
    ] == pytest.approx([1.02] * 6)


@in_float64
def test_a_point_mass_has_no_inertia_by_round_off(make_candidate):
    point = np.asarray(tool_parameters(jnp.asarray(1.3), jnp.array([0.0102, -0.0049, 0.06]), jnp.zeros(6)))
    cause = make_candidate("tool_inertia", parameters={"inertia": [2e-3, 0, 0, 2e-3, 0, 1e-3]})
    assert with_nominal(problem(theta=point), cause).nominal["inertia"] == [0.0] * 6


def test_table_and_page_show_both_values_with_their_unit(make_diagnosis, make_candidate):
    cause = make_candidate("tool_mass", nominal={"mass": 0.73})
    diagnosis = make_diagnosis(causes=(cause,))
    assert "  mass = 0.8134 ± 0.0041 kg (setup: 0.73 kg)" in to_table(diagnosis)
    html = to_html(diagnosis, "a log")
    assert "in the setup" in html
    assert "<td>0.73 kg</td><td>0.8134 ± 0.0041 kg</td>" in html


def test_other_joints_that_explain_as_much_are_named(make_candidate):
    """Axes 2 to 4 of most arms are parallel: which of their encoders is off, many a motion leaves open."""

    def at(joint, behind, gain):
        return make_candidate("encoder_offset", gain, parameters={"joint": joint, "offset": 0.01}, behind=behind)

    known, ranking = SimpleNamespace(duration=30.0), [at(4.0, 0.0, 2.0), at(3.0, 0.01, 1.99), at(1.0, 1.5, 0.5)]
    cause = ranking[0]._replace(statement="Joint 4 reads too much")
    found = causes._with_other_joints(known, cause, ranking)
    assert found.statement == "Joint 4 reads too much (or joint 3, which explains the log as well)"
    assert "or joint 3, which" in found.explanation
    assert causes._with_other_joints(known, cause, ranking[::2]) == cause
    assert causes._with_other_joints(known, make_candidate(), ranking) == make_candidate()
