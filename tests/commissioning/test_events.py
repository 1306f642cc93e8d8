"""Effects tied to the clock of one log are left out of a setup for other logs; those of motion or temperature stay."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ftbias_jax.commissioning.events import is_bias_alone, other_causes, same_causes, without_events
from ftbias_jax.commissioning.result import Calibrated
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.model.effects.fitting import Step, Touches
from ftbias_jax.setup import parse_setup

GIVEN = parse_setup({"robot": {"model": "panda"}, "sensor": {"noise_std": [0.1, 0.004]}})
WAVE = {"drive": "time", "form": "wave", "frequency": 0.02}
LOAD = {"drive": "acceleration", "form": "payload", "time": [3.0, 7.0]}
DRAG = {"drive": "velocity", "form": "linear"}


@pytest.mark.parametrize(
    ("causes", "kept", "forms", "alone"),
    [
        ((), (), ("wander",), True),
        (("cable",), (True,), ("wander",), True),
        (("cable",), (False,), ("wander",), False),
        ((), (True,), ("wander", "linear"), False),
    ],
)
def test_a_bias_that_wanders_alone_needs_no_better_forecasts(causes, kept, forms, alone):
    found = SimpleNamespace(causes=causes, terms=[SimpleNamespace(form=form) for form in forms])
    assert is_bias_alone(found, [SimpleNamespace(kept=x) for x in kept]) == alone


@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_events_and_the_course_of_the_bias_are_left_out(name):
    found, left_out = without_events(replace(GIVEN, effects={name: {}}), GIVEN)
    search = CATALOGUE[name].fit.search
    expected = isinstance(search, Step | Touches) or name == "warmup"
    assert (found.effects, left_out) == (({}, (name,)) if expected else ({name: {}}, ()))


def test_terms_that_go_by_the_clock_are_left_out_and_others_stay():
    setup = replace(GIVEN, effects={"low_pass": {}, "term": [DRAG, WAVE, LOAD]})
    found, left_out = without_events(setup, GIVEN)
    assert found.effects == {"low_pass": {}, "term": [DRAG]}
    assert left_out == ("term of time", "term of acceleration")


def test_what_the_owner_states_stays():
    given = replace(GIVEN, effects={"bias_jump": {}, "term": [WAVE]})
    assert without_events(given, given) == (given, ())
    further = replace(given, effects={**given.effects, "term": [WAVE, LOAD]})
    assert without_events(further, given)[0].effects == given.effects


LOOSE = {"mass": 1.0, "center_of_mass": np.zeros(3), "mass_std": 0.3, "center_of_mass_std": np.full(3, 0.03)}
DRAFT = replace(GIVEN, tool=replace(GIVEN.tool, **LOOSE))


@pytest.mark.parametrize("further", ["tool_inertia", "mount_translation", "gravity_tilt"])
def test_causes_are_the_same_whatever_is_said_of_what_a_draft_left_open(further):
    one = replace(DRAFT, effects={"low_pass": {"cutoff": 3.0}})
    other = replace(one, effects={**one.effects, further: {}})
    assert same_causes(one, other, DRAFT) == same_causes(other, one, DRAFT) == (further != "gravity_tilt")
    place_known = replace(DRAFT, sensor=replace(DRAFT.sensor, translation=np.array([0, 0, 0.03])))
    assert same_causes(one, other, place_known) == (further == "tool_inertia")
    assert not same_causes(one, other, GIVEN)


def test_what_a_draft_left_open_is_open_whatever_is_looked_for():
    others = other_causes(DRAFT, {"low_pass"})
    left_open = {"tool_mass", "tool_com", "tool_inertia", "mount_translation"}
    assert other_causes(GIVEN, {"low_pass"}) - others == left_open
    assert {"gain", "term"} < others
    assert "low_pass" not in others


def test_a_part_that_was_carried_is_weighed_by_another_command():
    made = Calibrated(GIVEN, (), {}, None, events=("term of acceleration", "bias_jump"))
    assert made.left_out.startswith(
        "events of these logs alone, left out of the setup: term of acceleration, bias_jump"
    )
    assert made.left_out.endswith("weigh it and the tool by ftbias identify --payloads")
    assert "payloads" not in replace(made, events=("bias_jump",)).left_out
    assert replace(made, events=()).left_out == ""
