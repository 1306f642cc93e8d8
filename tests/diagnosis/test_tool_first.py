"""A wrong tool beside another cause: both are found, and nothing is reported for a right tool."""

from dataclasses import replace

import numpy as np
import pytest

from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.diagnosis import tool_first
from ftbias_jax.diagnosis.diagnose import diagnose
from ftbias_jax.diagnosis.evidence.gap import CrossValidation
from ftbias_jax.diagnosis.hypothesis import at_values, at_zero, movable
from ftbias_jax.diagnosis.problem import make_problem
from ftbias_jax.diagnosis.regression.fit import base, fit
from ftbias_jax.model.simulate_log import simulate
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.setup import parse_setup

TRUE = parse_setup(SETUP)
OFF = np.array([0.004, -0.003, 0.005])


def with_tool(factor, off, *stds):
    mass_std, center_std = stds or (None, None)
    tool = replace(
        TRUE.tool,
        mass=factor * TRUE.tool.mass,
        center_of_mass=TRUE.tool.center_of_mass + off,
        mass_std=mass_std,
        center_of_mass_std=center_std,
    )
    return replace(TRUE, tool=tool)


DRAFTED = with_tool(0.86, OFF, 0.05, np.full(3, 0.005))


@pytest.fixture(scope="module")
def lagging():
    return simulate(TRUE, {"low_pass": {"cutoff": 2.0}}, duration=20, rate=100, seed=11).log


@pytest.fixture(scope="module")
def diagnosis(lagging):
    return diagnose(DRAFTED, [lagging])


def assert_tool_found(diagnosis):
    found = {cause.effect: cause for cause in diagnosis.causes}
    for name, key in {"tool_mass": "mass", "tool_com": "center_of_mass"}.items():
        value, stderr = (np.array(x[key]) for x in (found[name].parameters, found[name].stderr))
        np.testing.assert_array_less(np.abs(value - getattr(TRUE.tool, key)), 3.5 * stderr)


def test_a_drafted_tool_and_a_lag_are_found_together(diagnosis):
    assert diagnosis.verdict == "explained"
    assert [cause.effect for cause in diagnosis.causes] == ["low_pass", "tool_mass", "tool_com"]
    assert_tool_found(diagnosis)
    assert abs(diagnosis.causes[0].parameters["cutoff"] - 2.0) < 3 * diagnosis.causes[0].stderr["cutoff"]


def test_the_tool_of_a_draft_is_replaced_where_it_stands(diagnosis):
    mended = diagnosis.apply(DRAFTED)
    assert set(mended.effects) == {"low_pass"}
    assert abs(mended.tool.mass - TRUE.tool.mass) < 4 * mended.tool.mass_std < 0.05
    assert "ftbias diagnose" in mended.comments["tool.mass"]


def test_what_is_not_known_of_the_causes_is_written_for_the_error_bars(diagnosis):
    """The same with larger stated errors: a second diagnosis does not reduce the errors of the first."""
    of_lag = diagnosis.apply(DRAFTED).bias.model_std
    np.testing.assert_array_equal(of_lag, diagnosis.model_stderr)
    assert (of_lag > 0).all()
    assert (of_lag < TRUE.sensor.noise_std).all()
    known = replace(DRAFTED, bias=replace(DRAFTED.bias, model_std=np.array([1.0, 0, 0, 0, 0, 1])))
    np.testing.assert_array_equal(diagnosis.apply(known).bias.model_std, [1.0, *of_lag[1:5], 1.0])


@pytest.fixture(scope="module")
def elsewhere():
    """A log with a lag, and a draft that lacks the sensor's position on the flange and the tool's inertia."""
    log = simulate(TRUE, {"low_pass": {"cutoff": 3.0}}, duration=20, rate=100, seed=13).log
    draft = replace(DRAFTED, sensor=replace(TRUE.sensor, translation=np.zeros(3)))
    return log, replace(draft, tool=replace(draft.tool, inertia=np.zeros(6)))


def test_what_nobody_has_measured_is_open_beside_a_cause(elsewhere):
    log, draft = elsewhere
    found = diagnose(draft, [log])
    assert found.verdict == "explained"
    assert_tool_found(found)
    lag, place = (next(x for x in found.causes if x.effect == name) for name in ("low_pass", "mount_translation"))
    assert abs(lag.parameters["cutoff"] - 3.0) < 3 * lag.stderr["cutoff"]
    off = np.abs(np.array(place.parameters["translation"]) - TRUE.sensor.translation)
    np.testing.assert_array_less(off, 3.5 * np.array(place.stderr["translation"]))


@pytest.mark.slow
def test_a_place_that_is_stated_is_believed(elsewhere):
    log, draft = elsewhere
    stated = replace(draft, sensor=replace(draft.sensor, translation=np.array([0.0, 0.0, 0.04])))
    assert "mount_translation" not in {cause.effect for cause in diagnose(stated, [log]).causes}


@pytest.mark.slow
def test_a_tool_that_is_stated_is_suspected_where_no_cause_explains_alone(lagging):
    stated = diagnose(with_tool(0.86, OFF), [lagging])
    assert {cause.effect for cause in stated.causes} == {"low_pass", "tool_mass", "tool_com"}
    assert_tool_found(stated)
    assert set(stated.apply(TRUE).effects) == {"low_pass", "tool_mass", "tool_com"}


@pytest.mark.parametrize("stds", [(), (0.05, np.full(3, 0.005))], ids=["stated", "drafted"])
def test_of_a_right_tool_nothing_is_said(lagging, stds):
    (cause,) = diagnose(with_tool(1.0, 0.0, *stds), [lagging]).causes
    assert cause.effect == "low_pass"


@pytest.mark.slow
def test_effects_of_the_tool_that_may_not_be_named_are_not(lagging):
    found = diagnose(DRAFTED, [lagging], without=("tool_mass",))
    assert "tool_mass" not in [cause.effect for cause in found.causes]


FX_READS_LESS = np.array([0.8, 1, 1, 1, 1, 1])
LEAKS = np.eye(6)
LEAKS[3:, :3] = 1e-3 * np.array([[1, -2, 3], [4, -1, 2], [-3, 2, 4]])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "true"), [("gain", {"gain": FX_READS_LESS}), ("crosstalk", {"matrix": LEAKS})], ids=["gain", "crosstalk"]
)
def test_what_looks_like_a_tool_is_told_beside_it_and_leaves_it_right(effect, true):
    log = simulate(TRUE, {effect: true}, duration=20, rate=100, seed=12).log
    found = diagnose(with_tool(0.86, OFF), [log])
    assert {cause.effect for cause in found.causes} == {effect, "tool_mass", "tool_com"}
    assert_tool_found(found)
    if effect == "gain":
        (gain,) = (cause for cause in found.causes if cause.effect == "gain")
        assert np.flatnonzero(gain.stderr["gain"]).tolist() == [0]


def test_a_weight_beside_the_stated_one_is_a_tool_and_no_cable():
    log = simulate(TRUE, duration=20, rate=100, seed=13).log
    found = diagnose(with_tool(0.99, np.array([0.0, 0.001, 0.0])), [log])
    assert {cause.effect for cause in found.causes} == {"tool_mass", "tool_com"}
    assert not found.terms
    assert_tool_found(found)


def test_a_tool_beside_gains_is_as_uncertain_as_they_scatter():
    """The mean of the gains is indistinguishable from the mass."""
    true = np.array([0.96, 0.97, 1.06, 0.97, 1.03, 0.98])
    log = simulate(TRUE, {"gain": {"gain": true}}, duration=20, rate=100, seed=12).log
    found = {cause.effect: cause for cause in diagnose(DRAFTED, [log]).causes}
    mass, stderr = found["tool_mass"].parameters["mass"], found["tool_mass"].stderr["mass"]
    assert 0.005 < stderr / mass < 0.05
    assert abs(mass - TRUE.tool.mass) < 3 * stderr
    gain, stderr = (np.array(x["gain"]) for x in (found["gain"].parameters, found["gain"].stderr))
    assert 2 in np.flatnonzero(stderr)
    np.testing.assert_array_less(np.abs(gain - true)[stderr > 0], 3 * stderr[stderr > 0])


@pytest.mark.parametrize(("of_joints", "by_tool"), [(0.0, False), (500.0, True)])
@in_float64
def test_gains_that_do_what_a_tool_does_come_after_it(monkeypatch, of_joints, by_tool):
    setup = with_tool(0.88, OFF)
    log = simulate(TRUE, {"time_delay": {"delay": 0.03}}, duration=20, rate=100, seed=14).log
    problem, _ = make_problem(setup, [log])
    nominal, known = base(problem), problem.catalogue
    delay = at_values(problem, known["time_delay"], delay=0.03)
    gains = at_values(problem, known["gain"], gain=np.full(6, 1.1))
    by_gains = fit(problem, (gains, delay, at_zero("tool_com", movable(problem, known["tool_com"]))), nominal)

    # The gains explain 2 % more of the residual, spread over the log.
    by_gains = by_gains._replace(error=0.99 * by_gains.error, log_likelihood=0.99**2 * by_gains.log_likelihood)

    def search(problem, start, *given):
        return (fit(problem, (*start.hypotheses, delay), start) if start.hypotheses else by_gains), []

    monkeypatch.setattr(tool_first, "search", search)
    monkeypatch.setattr(tool_first, "nats_of_joints", lambda problem: of_joints)
    found = tool_first.search_causes(setup, problem, nominal, CrossValidation(problem))
    told = {h.effect for h in found.accepted.hypotheses}
    assert told == {"time_delay", "tool_com", "tool_mass" if by_tool else "gain"}
