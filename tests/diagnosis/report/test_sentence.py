"""The headline: at most forty words with the quantity, its value and unit, its effect on the error, and what to do."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ftbias_jax.cli.commands import demo
from ftbias_jax.diagnosis.evidence.causes import in_order
from ftbias_jax.diagnosis.evidence.estimates import statement_of
from ftbias_jax.diagnosis.evidence.gap import differ, worsened
from ftbias_jax.diagnosis.report.sentence import MOST_WORDS, disagreement, headline, note
from ftbias_jax.diagnosis.result import Candidate, FoundTerm, Gap, LogGap, Regime, Where
from ftbias_jax.diagnosis.terms.found import statement
from ftbias_jax.diagnosis.terms.grid import make_term
from ftbias_jax.diagnosis.terms.phrases import check, resembles
from ftbias_jax.model.effects.catalogue import CATALOGUE, typical_values
from ftbias_jax.model.effects.terms.columns import count_columns
from ftbias_jax.model.effects.terms.forms import FORMS
from ftbias_jax.model.effects.types import Model
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.setup import parse_setup

SETUP = parse_setup(demo.SETUP)
PARAMS = params_from_setup(SETUP)
MODEL = Model(PARAMS.arm, PARAMS.gravity, PARAMS.theta)
NOISE = np.repeat([0.10, 0.004], 3)
GAP = Gap(NOISE * [3, 3, 3, 1, 1, 1], NOISE, NOISE, 2.4, 1.0, 0.98, 0.01)
UNITS = r"(kg( m\^2)?|mm|m|deg|N|Nm|%|ms|s|Hz|nats)"


def found(effect, share=0.01, **changes):
    """The effect with typical values, as a diagnosis names it."""
    values = {name: np.asarray(value, float) for name, value in typical_values(effect, MODEL).items()}
    stderr = {name: share * np.abs(value) + 1e-9 for name, value in values.items()}
    base = Candidate(
        effect.name, effect.stage, (), (), {n: x.tolist() for n, x in values.items()},
        {n: x.tolist() for n, x in stderr.items()}, 1.9, 0.1, 0.9, effect.explanation, effect.remedy,
    )  # fmt: skip
    nominal = {p.name: np.asarray(p.neutral(MODEL), float) for p in effect.parameters if callable(p.neutral)}
    return base._replace(statement=statement_of(effect, base, nominal))._replace(**changes)


def assert_complete(text):
    assert len(text.split()) <= MOST_WORDS, text
    assert re.search(rf"\d ?{UNITS}\b|\d %", text), text
    assert text.endswith("."), text
    assert text[0] == text[0].upper() or text[:2] in ("fx", "fy", "fz", "tx", "ty", "tz"), text
    assert not re.search(r"\[|numbers, the largest|nan", text), text
    action = text.rstrip(".").rpartition(". ")[2]
    assert len(action.split()) >= 2, text


@pytest.mark.parametrize("name", CATALOGUE)
@pytest.mark.parametrize("verdict", ["explained", "partly_explained"])
def test_every_effect_has_a_headline(name, verdict):
    text = headline(verdict, GAP, (found(CATALOGUE[name]),))
    assert_complete(text)
    assert re.search(r"error falls from 0.3 (N )?to 0.1 N \(noise 0.1", text)
    assert ("the cause is not certain" in text) is (verdict == "partly_explained")
    text = headline(verdict, GAP._replace(after_sigmas=1.5), (found(CATALOGUE[name]),))
    assert ("the rest is not explained" in text) is (verdict == "partly_explained")


@pytest.mark.parametrize("one", ["tool_com", "encoder_offset", "vibration"])
@pytest.mark.parametrize("other", ["warmup", "tool_mass", "cable"])
def test_two_causes_are_both_named(one, other):
    text = headline("explained", GAP, (found(CATALOGUE[one]), found(CATALOGUE[other])))
    assert_complete(text)
    statements = [found(CATALOGUE[name]).statement for name in (one, other)]
    assert statements[0][1:] in text
    assert statements[1] in text or other in text


@pytest.mark.parametrize("key", [key for key in FORMS if key[0] != "noise"], ids=" ".join)
def test_every_term_has_a_headline(key):
    form = FORMS[key]
    numbers = {parameter.name: 2.0 for parameter in form.parameters}
    acts_as = "force" if form.kind == "vectors" else "wrench"
    term = make_term(*key, "sensor" if form.kind == "channels" else "base", acts_as, 2, numbers)
    count = count_columns(term)
    term, stderr = replace(term, coefficients=np.full(count, 1.5)), np.full(count, 0.03)
    said = statement(term, np.full(count, 1.5), stderr, "0.35 N")
    described = FoundTerm(
        *key,
        "base",
        acts_as,
        said,
        *[{}] * 4,
        None,
        (),
        (),
        resembles(term, stderr),
        check(term, stderr),
        1.0,
        0.1,
        0.9,
        {},
        said,
    )
    text = headline("described", GAP, (described,))
    assert_complete(text)
    lengths = {("time", "step"): "about 2.6 N", ("time", "exponential"): "about 3.7 N", ("time", "wave"): "about 3.7 N"}
    assert ("1.500 ± 0.030" if count == 1 else lengths.get(key, "about 0.35 N")) in text


@pytest.mark.parametrize(
    ("total", "order"),
    [
        (4.0, ["saturation", "tool_mass", "term", "noise_level"]),
        (0.01, ["noise_level", "saturation", "tool_mass", "term"]),
    ],
)
def test_what_single_samples_show_is_told_behind_what_explains_the_mean_unless_the_gap_is_small(total, order):
    term = FoundTerm("time", "step", "base", "force", "a force", *[{}] * 4, None, (), (), (), "", 1, 0.1, 0.9, {})
    causes = [found(CATALOGUE[name]) for name in order if name != "term"]
    answer = SimpleNamespace(problem=SimpleNamespace(catalogue=CATALOGUE), terms=(term,), total=total)
    assert [getattr(one, "effect", "term") for one in in_order(answer, causes)] == order


def test_the_tool_is_told_with_the_setup_and_its_twin():
    mass = found(CATALOGUE["tool_mass"], indistinguishable_from=("gain",))
    equal = found(CATALOGUE["gain"])
    equal = equal._replace(statement="all six channels read 8.0 ± 0.1 % too much")
    text = headline("explained", GAP, (mass,), candidates=(mass, equal))
    assert re.match(r"The tool weighs [\d.]+ ± [\d.]+ kg, the setup says [\d.]+ \(or all six channels read 8.0", text)
    assert_complete(text)
    assert "(or gain)" in headline("explained", GAP, (mass,))


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ([1.08] * 6, "all six channels read 8.00 ± 0.10 % too much"),
        ([1, 1, 0.97, 1, 1, 1], "fz reads 3.00 ± 0.10 % too little"),
        ([1, 1.02, 1, 1, 1.05, 1], "fy and ty read 2.00 ± 0.10 % too much"),
        ([1.1, 1.02, 1, 1, 1.05, 1], "fx and others read 10.00 ± 0.10 % too much"),
        ([1, 1.02, 1, 1, 0.95, 1], "fy (ty differently) reads 2.00 ± 0.10 % too much"),
    ],
)
def test_a_gain_says_which_channels(values, words):
    cause = found(CATALOGUE["gain"])._replace(parameters={"gain": values}, stderr={"gain": [0.001] * 6})
    assert statement_of(CATALOGUE["gain"], cause, {}).startswith(words)


def test_the_surest_leak_is_told_not_the_largest_number():
    matrix, stderr = np.eye(6), np.zeros((6, 6))
    matrix[0, 5], stderr[0, 5] = 0.30, 0.5  # N per Nm, not known
    matrix[3, 1], stderr[3, 1] = 0.0014, 0.0015  # Nm per N, small numbers by their unit
    matrix[1, 0], stderr[1, 0] = 0.02, 0.001
    cause = found(CATALOGUE["crosstalk"])._replace(parameters={"matrix": matrix}, stderr={"matrix": stderr})
    assert statement_of(CATALOGUE["crosstalk"], cause, {}) == "2.00 ± 0.10 % of fx leaks into fy"


def test_a_small_gap_is_called_small_and_has_no_percentage():
    small = GAP._replace(before_rms=1.07 * NOISE, before_sigmas=1.07)
    text = headline("explained", small, (found(CATALOGUE["tool_mass"]),))
    assert "a small gap, the error is 0.107 N where noise alone leaves 0.1 N" in text
    assert "100" not in text


def test_what_nobody_can_name_says_where_to_look():
    where = Where((), {"fz": 0.7, "tx": 0.3}, (), (Regime("fast wrist motion", 0.7, 0.3),), ())
    text = headline("unknown", GAP, (), where=where)
    assert text.endswith("Look at fz during fast wrist motion first.")
    assert_complete(text)
    none = headline("none", GAP._replace(before_rms=NOISE), ())
    assert none == "The log agrees with the setup: the error is 0.1 N where noise alone leaves 0.1 N. Nothing to do."


def test_what_single_samples_show_does_not_promise_a_gap():
    level = GAP._replace(before_rms=NOISE, before_sigmas=1.001, shrink=0.0)
    assert "the mean reading agrees with the setup" in headline("explained", level, (found(CATALOGUE["outliers"]),))


def test_an_own_effect_without_a_statement_says_its_explanation_and_first_number():
    own = CATALOGUE["time_delay"]._replace(name="mine", statement=None)
    assert statement_of(own, found(own), {}) == f"{own.explanation} (delay 0.01000 ± 0.00010 s)"


@pytest.mark.parametrize(("std", "said"), [(None, False), (np.zeros(6), False), (np.array([0, 0.1, 0, 0, 0, 0]), True)])
def test_correlated_noise_of_the_setup_is_said_to_be_left_out(std, said):
    setup = replace(SETUP, sensor=replace(SETUP.sensor, correlated_std=std, correlated_time=np.ones(6)))
    assert ("correlated noise is not used" in note(setup)) is said


def test_a_drafted_tool_and_a_log_at_rest_are_said_beside_the_headline():
    draft = replace(SETUP, tool=replace(SETUP.tool, mass_std=0.1))
    found = replace(SETUP, tool=replace(SETUP.tool, mass_std=1e-5, center_of_mass_std=np.full(3, 1e-6)))
    assert "fitted beside all causes: run ftbias identify with the setup that --apply writes" in note(draft)
    assert note(found) == note(SETUP) == ""
    assert note(draft, "at rest: bias shows").endswith("--apply writes. At rest: bias shows.")


def test_logs_that_do_not_share_their_causes_are_named():
    """What explains them together makes the good ones worse: nobody should apply that."""
    bad, good = LogGap("c.csv", 56.0, 23.0, 1.0, {}, {}), LogGap("a.csv", 1.0, 14.4, 1.0, {}, {})
    fine = LogGap("b.csv", 1.0, 1.3, 0.0, {}, {})
    worse = worsened([good, fine, bad])
    assert worse == (good,)
    text = disagreement([good, fine, bad], worse)
    assert "raises the error of a.csv from 1 to 14 noise sigmas" in text
    assert "c.csv first; do not apply" in text
    assert "b.csv" not in text
    assert worsened([fine, bad]) == worsened([]) == ()


def test_logs_of_different_tools_are_told_with_the_sizes_of_both():
    """What separate parameters would remove of what shared ones leave decides: no arm is the same on every day."""
    masses = {"a.csv": 1.216, "b.csv": 1.22, "c.csv": 1.407}
    logs = [
        LogGap(name, 60.0, 30.0, 40.0, {"tool_mass": {"mass": mass}, "cable": {}}, {"tool_mass": {"mass": 0.002}})
        for name, mass in masses.items()
    ]
    assert differ([log._replace(left=50.0) for log in logs])
    assert not differ([log._replace(left=100.0) for log in logs])
    assert not differ([log._replace(own_gain=0.1, left=0.1) for log in logs])
    text = disagreement(logs, ())
    assert text == (
        "The logs do not share one size of tool_mass, and cable: mass 1.2160 ± 0.0020 in a.csv and 1.4070 ± 0.0020 in "
        "c.csv. Diagnose them one by one; do not apply this."
    )
    forces = [log._replace(parameters={"contact": {"force": [[1.0, 0.0, 0.0]]}}, stderr={}) for log in logs]
    assert disagreement(forces, ()).startswith("The logs do not share one size of contact. Diagnose")


def test_a_log_that_contradicts_a_small_cause_of_another_is_named():
    """Its error hardly grows, but without the cause it is far likelier; a loss that form errors make is none."""
    has, healthy = LogGap("b.csv", 1.2, 1.0, 1.0, {}, {}, 900.0), LogGap("a.csv", 1.0, 1.0, 2.2, {}, {}, -66.0)
    assert worsened([has, healthy]) == (healthy,)
    text = disagreement([has, healthy], [healthy])
    assert text.startswith("The logs do not share one cause: what explains them together contradicts a.csv.")
    assert worsened([has._replace(nats=9000.0), healthy]) == worsened([has, healthy._replace(nats=-9.0)]) == ()
