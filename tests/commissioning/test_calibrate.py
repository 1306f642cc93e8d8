"""The steps from a log to a setup: which are kept, which are refused, and all of them on a simulated log."""

import tomllib
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from made_judged import judged

import ftbias_jax as ft
from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.commissioning import calibrate as module
from ftbias_jax.commissioning import repeat, state
from ftbias_jax.commissioning.calibrate import calibrate
from ftbias_jax.commissioning.drafted import as_uncertain, loosened, with_loose_tool
from ftbias_jax.commissioning.judged import CONSTANT, HELD_TARE
from ftbias_jax.commissioning.result import CALIBRATED, GIVEN
from ftbias_jax.errors import LogError, UsageError
from ftbias_jax.model.simulate_log import simulate
from ftbias_jax.setup import parse_setup

TRUE = parse_setup(SETUP)
LOG = simulate(TRUE, duration=4, rate=50, seed=3).log
CAUSE = SimpleNamespace(effect="low_pass", title="low_pass", parameters={"cutoff": 3.0}, stderr={"cutoff": 0.1})


def of_mass(setup, mass):
    return replace(setup, tool=replace(setup.tool, mass=mass))


def readings(log):
    return int(np.isfinite(log.wrench).all(1).sum())


@pytest.fixture
def faked(monkeypatch):
    """Calibrations whose diagnosis, identification and errors are made up.

    Arguments of the returned function: errors by (effects, mass); causes of a diagnosis; the identified mass; further
    causes that only the whole log shows; standard errors of the tool beside the causes.
    """

    def make(errors, causes=(), mass=1.0, trouble=None, late=(), beside=None):
        beside = beside or {}
        calls = []

        def judge(setup, logs, hold_out):
            return judged(errors(set(setup.effects), setup.tool.mass))

        def diagnose(setup, logs, names, without=(), unchecked=False):
            calls.append(("diagnose", readings(logs[0])))
            shown = (*causes, *(late if readings(logs[0]) == len(LOG.t) else ()))
            found = [cause for cause in shown if cause.effect not in {*setup.effects, *without}]
            return SimpleNamespace(
                causes=found,
                terms=(),
                sentence="nothing is left",
                verdict="none",
                tool_stderr=beside,
                model_stderr=None,
            )

        def with_causes(setup, causes, terms=(), model_stderr=None):
            return replace(setup, effects={**setup.effects, **{cause.effect: cause.parameters for cause in causes}})

        def identify_tool(setup, log, mounting=False, crosstalk=False, bias=False, translation=None, unchecked=True):
            calls.append(("identify", readings(log)))
            if trouble:
                raise LogError(trouble)
            found = of_mass(setup, mass)
            if bias:
                found = replace(found, bias=replace(found.bias, initial=np.full(6, 7.0)))
            tool = SimpleNamespace(values=np.full(10, mass), stderr=np.full(10, 0.01), remarks=("",) * 10)
            return SimpleNamespace(setup=found, tool=tool, converged=True, channels=None)

        def compiled_ahead(setup, logs):
            return nullcontext()

        def programs_of_search(setup, logs):
            return ()

        for fake in (judge, diagnose, with_causes, identify_tool, compiled_ahead, programs_of_search):
            for place in (module, repeat, state):
                monkeypatch.setattr(place, fake.__name__, fake, raising=place is module)
        return calls

    return make


def test_what_predicts_better_is_kept_and_repeated_with_all_of_the_log(faked):
    late = SimpleNamespace(effect="backlash", parameters={"width": 0.01})
    calls = faked(lambda effects, mass: 0.5 if effects else 1.0, [CAUSE], mass=2.0, late=[late])
    found = calibrate(TRUE, [LOG], unchecked=True)
    assert [(step.kind, step.kept) for step in found.steps] == [
        ("tool, first", True),  # first, because a cause would mimic a wrong tool
        ("causes", True),
        ("tool", True),  # it predicts no worse, and the setup states no standard error of the tool
        ("causes", False),
        ("gains and crosstalk", False),  # last, because they would mimic a cause
    ]
    assert set(found.setup.effects) == {"low_pass"}
    assert found.setup.tool.mass == 2.0
    begun = round(0.75 * len(LOG.t))
    assert calls[:2] == [("identify", begun), ("diagnose", begun)]
    whole = [name for name, count in calls if count == len(LOG.t)]  # partly while round two finds nothing
    assert whole == ["identify", "diagnose", "identify"]
    assert list(found.rows) == [GIVEN, CALIBRATED, HELD_TARE, CONSTANT]
    assert "errors 50" in found.steps[1].why
    assert found.constant_is_better == ()


def test_what_predicts_worse_is_told_and_not_kept(faked):
    calls = faked(lambda effects, mass: 1.0 + len(effects) + (mass == 2.0), [CAUSE], mass=2.0)
    found = calibrate(TRUE, [LOG], unchecked=True)
    assert not found.kept
    assert found.setup.tool is TRUE.tool
    assert found.setup.effects == TRUE.effects
    assert "larger" in found.steps[0].why
    assert found.sentence.startswith("Nothing")
    assert {count for _, count in calls} == {round(0.75 * len(LOG.t))}


def test_what_all_of_the_log_makes_worse_is_not_repeated(faked, monkeypatch):
    faked(lambda effects, mass: 0.5 if effects else 1.0, [CAUSE])
    whole = SimpleNamespace(setup=of_mass(TRUE, 9.0), sentence="")
    monkeypatch.setattr(module, "repeat", lambda *_: whole.setup)
    found = calibrate(TRUE, [LOG], unchecked=True)
    assert found.setup.tool.mass == 1.0
    assert set(found.setup.effects) == {"low_pass"}


def test_a_tool_that_only_predicts_as_well_is_not_taken_twice(faked):
    """The tool is sought again only after a second round has changed something else."""

    def errors(effects, mass):
        return 0.5 if effects and [kind for kind, _ in calls].count("diagnose") > 1 else 1.0

    calls = faked(errors, [CAUSE], mass=2.0)
    steps = calibrate(TRUE, [LOG], unchecked=True).steps
    assert [step.kept for step in steps if step.kind == "causes"] == [False, True, False]
    assert [step.kept for step in steps if step.kind == "tool"] == [True, False]
    faked(lambda effects, mass: 1.0, mass=2.0)
    assert [step.kept for step in calibrate(TRUE, [LOG], unchecked=True).steps if step.kind == "tool"] == [True]


def test_logs_of_different_tools_are_told(faked, monkeypatch):
    faked(lambda effects, mass: 1.0)
    monkeypatch.setattr(module, "judge", lambda *_: judged(1.0)._replace(tool_error=np.array([0.11, 0.0])))
    other = [[repair.what for repair in log] for log in module.calibrate(TRUE, [LOG, LOG]).repairs]
    assert "is 1.11 times what the calibrated tool causes" in other[0][-1]
    assert "calibrate each of them alone" in other[0][-1]
    assert not any("times" in what for what in other[1])
    monkeypatch.setattr(module, "judge", lambda *_: judged(1.0)._replace(tool_error=np.array([0.11])))
    assert module.calibrate(TRUE, LOG).repairs == ((),)


def test_causes_may_still_move_a_tool_that_was_identified_without_them(faked):
    """Once identified beside them, a tool that nothing has changed keeps the standard errors of its identification."""
    faked(lambda effects, mass: 1.0 if mass == 2.0 else 3.0, mass=2.0)
    start = with_loose_tool(TRUE)
    exact = replace(TRUE, tool=replace(TRUE.tool, mass=2.0, mass_std=1e-3, center_of_mass_std=np.full(3, 1e-4)))
    loose = loosened(exact, start).tool
    assert (loose.mass, loose.mass_std) == (2.0, start.tool.mass_std)
    assert calibrate(TRUE, [LOG], unchecked=True).setup.tool.mass == 2.0


def test_a_tool_is_as_uncertain_as_the_causes_beside_it(faked):
    """An identification with fixed causes does not include the causes' errors."""
    stated = replace(TRUE, tool=replace(TRUE.tool, mass_std=0.3, center_of_mass_std=np.full(3, 1e-3)))
    beside = {"mass": np.array(0.2), "center_of_mass": np.array([5e-4, 0.02, 0.03])}
    faked(lambda effects, mass: 0.5 if effects else 1.0, [CAUSE], mass=2.0, beside=beside)
    found = calibrate(stated, [LOG], unchecked=True)
    assert "tool: 2.00 ± 0.30 kg" in [step.name for step in found.steps]
    assert found.setup.tool.mass_std == 0.3
    np.testing.assert_array_equal(found.setup.tool.center_of_mass_std, [1e-3, 0.02, 0.03])


def test_the_comment_of_a_value_has_the_standard_error_that_the_setup_states():
    tool = replace(TRUE.tool, mass_std=0.1)
    found = as_uncertain(replace(TRUE, tool=tool, comments={"tool.mass": "identified ± 0.1"}), {"mass": np.array(0.2)})
    assert (found.tool.mass_std, found.comments["tool.mass"]) == (0.2, "identified ± 0.2")


def test_what_cannot_be_tried_is_told_with_its_reason(faked):
    faked(lambda effects, mass: 1.0, trouble="is of an arm at rest")
    found = calibrate(TRUE, [LOG], unchecked=True)
    assert [(step.kind, step.why) for step in found.steps] == [
        ("tool, first", "is of an arm at rest"),
        ("causes", "nothing is left"),
        ("tool", "is of an arm at rest"),
        ("gains and crosstalk", "is of an arm at rest"),
    ]
    assert "is of an arm at rest" in str(found)


def test_the_bias_is_taken_where_it_is_asked_for_and_the_tool_stays(faked):
    faked(lambda effects, mass: 1.0 + (mass == 2.0), mass=2.0)
    found = calibrate(TRUE, [LOG], bias=True, unchecked=True)
    assert found.setup.tool is TRUE.tool
    np.testing.assert_array_equal(found.setup.bias.initial, 7.0)


def test_a_bias_that_is_held_is_told_where_it_predicts_better(faked):
    faked(lambda effects, mass: 8.0)
    found = calibrate(TRUE, [LOG], unchecked=True)
    assert "fx 1 s ahead" in found.constant_is_better
    assert "a bias that is held predicts better" in str(found)


def test_stated_errors_of_a_tool_stay_and_missing_ones_are_wide():
    loose = with_loose_tool(TRUE).tool
    assert loose.mass_std == pytest.approx(0.3 * TRUE.tool.mass)
    stated = replace(TRUE, tool=replace(TRUE.tool, mass_std=1e-3, center_of_mass_std=np.full(3, 1e-4)))
    assert with_loose_tool(stated).tool.mass_std == 1e-3
    unknown = with_loose_tool(of_mass(TRUE, np.nan)).tool
    assert unknown.mass_std == 1.0
    without = replace(TRUE, sensor=replace(TRUE.sensor, compensated="tool"))
    assert with_loose_tool(without) is without


POSES = """
[sensor_pose]
linear = "none"
acceleration_std = 0.3
[sensor]
noise_std = [0.1, 0.1, 0.1, 0.004, 0.004, 0.004]
[tool]
mass = 0.73
center_of_mass = [0.0, 0.0, 0.06]
"""


@pytest.mark.parametrize(("true", "found"), [(0.03, 0.033), (0.3, 0.3), (2.5, 2.7)])
def test_unseen_accelerations_of_a_log_of_orientations_are_found_in_steps(monkeypatch, true, found):
    """Smaller, larger or the stated accelerations are kept; one step reports the result."""

    def judge(setup, logs, hold_out):
        return judged(1 + abs(np.log(setup.pose.acceleration_std / true)))

    monkeypatch.setattr(module, "judge", judge)
    setup = parse_setup(tomllib.loads(POSES))
    begin = state.State(setup, judge(setup, (), 0.25), ())
    after = module._with_noise(begin, state.Context((), (), (), 0.25, lambda words: None, None, None))
    assert after.setup.pose.acceleration_std == found
    (step,) = after.steps[-1:]
    assert step.kept is (found != 0.3)
    assert step.parts == ("noise",)


def test_joints_have_no_unseen_accelerations():
    begin = state.State(TRUE, judged(), ())
    assert module._with_noise(begin, state.Context((), (), (), 0.25, lambda words: None, None, None)) is begin


@pytest.mark.parametrize(("logs", "hold_out", "field"), [([], 0.25, "logs"), ([LOG], 0.95, "hold_out")])
def test_wrong_arguments_are_refused(logs, hold_out, field):
    with pytest.raises(UsageError) as error:
        calibrate(TRUE, logs, hold_out=hold_out)
    assert error.value.field == field


def test_page_and_numbers(faked, tmp_path):
    faked(lambda effects, mass: 0.5 if effects else 1.0, [CAUSE])
    found = calibrate(TRUE, [LOG], unchecked=True)
    found.to_html(tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text()
    assert "low_pass" in text
    assert "http" not in text.replace("http-equiv", "")
    numbers = found.plain()
    assert set(numbers["kept"]) == {"low_pass", "tool"}
    assert {refused["what"] for refused in numbers["refused"]} >= {"gains and crosstalk"}
    assert set(numbers["forecast"]) == {"1", "10"}
    for horizon in numbers["forecast"].values():
        np.testing.assert_allclose(horizon["ours"], 0.5, rtol=0.1)
        np.testing.assert_allclose(horizon["given"], 1.0, rtol=0.1)
        np.testing.assert_allclose(horizon["constant"], 5.0, rtol=0.1)
        np.testing.assert_allclose(horizon["coverage"], 0.95, atol=0.02)
    assert numbers["used"] == 1
    assert numbers["seconds"] > 0


@pytest.mark.slow
def test_a_wrong_tool_and_a_lag_on_a_made_log():
    made = simulate(TRUE, {"low_pass": {"cutoff": 2.0}}, duration=60, rate=100, seed=5)
    wrong = replace(TRUE, tool=replace(TRUE.tool, mass=0.8 * TRUE.tool.mass))
    found = ft.calibrate(wrong, [made.log])
    assert set(found.setup.effects) == {"low_pass"}
    assert abs(found.setup.tool.mass - TRUE.tool.mass) < 4 * found.setup.tool.mass_std
    before, after = found.rows[GIVEN], found.rows[CALIBRATED]
    assert (after.rms[:, :3] < before.rms[:, :3]).all()
    assert np.nanmean(after.inside) > 0.9
