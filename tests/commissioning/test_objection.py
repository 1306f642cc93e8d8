"""A setup with the causes found is not written if it predicts worse, and the responsible cause is named."""

from types import SimpleNamespace

import numpy as np
import pytest
from made_judged import judged

from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.commissioning import judged as module
from ftbias_jax.errors import LogError
from ftbias_jax.model.simulate_log import simulate
from ftbias_jax.setup import parse_setup

STATED = parse_setup(SETUP)
LOG = simulate(STATED, duration=2, rate=50, seed=3).log
GOOD, BAD = ("low_pass", {"cutoff": 3.0}), ("time_delay", {"delay": 0.4})


def cause(name, parameters):
    return SimpleNamespace(effect=name, title=name, parameters=parameters, stderr={})


@pytest.fixture
def objection(monkeypatch, make_diagnosis):
    """Objection to causes; a setup's errors are twice as large with a delay and half as large with only a low-pass."""

    def judge(setup, logs, hold_out):
        assert hold_out == 1.0
        return judged(2.0 if "time_delay" in setup.effects else 0.5 if setup.effects else 1.0, seed=len(setup.effects))

    monkeypatch.setattr(module, "judge", judge)
    monkeypatch.setattr("ftbias_jax.diagnosis.apply.parameter_words", lambda cause: ())
    return lambda *causes: module.objection(STATED, make_diagnosis(causes=tuple(cause(*x) for x in causes)), [LOG])


def test_what_predicts_better_is_written(objection):
    assert objection(GOOD) == ""


def test_what_predicts_worse_is_not_and_the_part_that_does_it_is_named(objection):
    assert objection(BAD).startswith("the setup with what was found predicts these logs worse: errors ")
    said = objection(GOOD, BAD)
    assert "because of time_delay: " in said
    assert "low_pass" not in said


def test_with_a_setup_that_filters_nothing_there_is_nothing_to_compare(objection, monkeypatch):
    def judge(setup, logs, hold_out):
        if not setup.effects:
            raise LogError("no tool")
        return judged(np.e)

    monkeypatch.setattr(module, "judge", judge)
    assert objection(GOOD) == ""


def test_logs_that_cannot_be_filtered_with_it_are_a_reason(objection, monkeypatch):
    def judge(setup, logs, hold_out):
        if setup.effects:
            raise LogError("is not finite")
        return judged()

    monkeypatch.setattr(module, "judge", judge)
    assert "cannot be filtered with it: " in objection(GOOD)
