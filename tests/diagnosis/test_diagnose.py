"""The whole diagnosis on simulated logs: the cause by name, none where there is no gap, unknown without the cause."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.diagnosis.diagnose import diagnose
from ftbias_jax.diagnosis.evidence.estimates import FORM_ERROR
from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.diagnosis.problem import make_problem
from ftbias_jax.diagnosis.regression.coordinates import layout
from ftbias_jax.diagnosis.regression.fit import base, fit
from ftbias_jax.model.simulate_log import simulate


@pytest.mark.slow
def test_a_log_of_the_model_has_no_cause(setup, record):
    diagnosis = diagnose(setup, record(None), ["plain"])  # alone, as a list of one
    assert diagnosis.verdict == "none"
    assert diagnosis.causes == ()
    assert diagnosis.gap.before_sigmas < 1.01


@pytest.mark.slow
def test_an_axis_that_stands_still_is_named_and_no_contact(setup, record):
    """Its samples would look like a push of the same duration."""
    log = record(None)
    wrench = np.array(log.wrench)
    wrench[1000:1800, 2] = wrench[1000, 2]
    diagnosis = diagnose(setup, [log._replace(wrench=wrench)], ["frozen"])
    assert (diagnosis.verdict, diagnosis.causes) == ("none", ())
    assert diagnosis.gap.before_sigmas < 1.01
    assert diagnosis.losses == ("frozen: fz stands still from 5.0 s to 9.0 s: 800 samples left out",)


@pytest.mark.slow
def test_a_wrong_mass_is_named_measured_and_removed(setup, record):
    diagnosis = diagnose(setup, [record({"tool_mass": {"mass": jnp.array(0.96)}})], ["heavy"])
    assert diagnosis.verdict == "explained"
    (cause,) = diagnosis.causes
    assert cause.effect == "tool_mass"
    assert set(cause.indistinguishable_from) <= {"gain"}
    assert abs(cause.parameters["mass"] - 0.96) < 3 * cause.stderr["mass"]
    assert cause.held_out_gain > 5 * cause.held_out_gain_stderr > 0
    assert diagnosis.gap.shrink > 0.95
    assert diagnosis.candidates[0].effect in ("tool_mass", "gain")


@pytest.mark.slow
def test_a_sensor_that_sits_elsewhere_on_the_flange_is_named_and_measured(setup, record):
    """As in a drafted setup, which places the sensor at the flange's origin."""
    place = np.array([0.01, 0.0, 0.04])
    diagnosis = diagnose(setup, [record({"mount_translation": {"translation": jnp.array(place)}})], ["elsewhere"])
    assert diagnosis.verdict == "explained"
    (cause,) = diagnosis.causes
    assert cause.effect == "mount_translation"
    assert (np.abs(cause.parameters["translation"] - place) < 3 * np.asarray(cause.stderr["translation"])).all()
    assert np.linalg.norm(cause.stderr["translation"]) < 0.2 * np.linalg.norm(place)


@pytest.mark.slow
@pytest.mark.parametrize("stated", [{}, {"low_pass": {"cutoff": 0.4}}])
def test_what_a_lag_remembers_of_the_time_before_the_log_is_no_cause(setup, record, stated):
    log = record({"low_pass": {"cutoff": jnp.array(0.4)}})
    rows = {name: getattr(log, name)[500:] for name in ("q", "dq", "wrench", "temperature")}
    log = log._replace(t=log.t[500:] - log.t[500], **rows)
    diagnosis = diagnose(replace(setup, effects=stated), [log], ["cut"])
    assert [cause.effect for cause in diagnosis.causes] == ([] if stated else ["low_pass"])
    assert diagnosis.terms == ()
    assert diagnosis.verdict == ("none" if stated else "explained")


@pytest.mark.slow
def test_a_tool_on_one_hinge_is_named_with_its_share(setup, record):
    share = np.array([0, 0, 0, 0.7, 0, 0])
    loose = {"frequency": jnp.array(5.0), "damping_ratio": jnp.array(0.04), "share": share, "sagging": jnp.array(1.0)}
    diagnosis = diagnose(setup, [record({"tool_flexibility": loose})], ["loose"])
    assert diagnosis.verdict == "explained"
    (cause,) = diagnosis.causes
    assert cause.effect == "tool_flexibility"
    for name, true in loose.items():
        off = np.abs(np.asarray(cause.parameters[name]) - np.asarray(true))
        assert (off <= 3 * np.asarray(cause.stderr[name]) + 0.02).all(), name
    assert diagnosis.gap.shrink > 0.95


@pytest.mark.slow
def test_all_of_a_crosstalk_matrix_is_within_its_errors(setup, record):
    """Entries that look alike on this motion have wide errors; with only a few entries they would be far too small."""
    matrix = np.eye(6)
    matrix[0, 2], matrix[2, 4], matrix[4, 0] = 0.04, -0.3, 0.003
    diagnosis = diagnose(setup, [record({"crosstalk": {"matrix": jnp.array(matrix)}})], ["leaking"])
    cause = diagnosis.causes[0]
    assert cause.effect == "crosstalk"
    off, stderr = np.array(cause.parameters["matrix"]) - matrix, np.array(cause.stderr["matrix"])
    assert (np.abs(off) <= 3 * stderr).all()
    assert stderr[0, 2] < 0.01
    assert (stderr[~np.eye(6, dtype=bool)] > 0).all()


@pytest.mark.slow
def test_a_contact_beside_a_wrong_tool_is_told_apart(setup, record):
    """There are two presses 1.2 s apart; the tool's motion between them is not contact."""
    effects = {
        "tool_com": {"center_of_mass": jnp.array([0.02, -0.01, 0.07])},
        "contact": {
            "start": jnp.array([6.0, 8.2]),
            "end": jnp.array([7.0, 9.0]),
            "force": jnp.array([[3.0, 0.0, 2.0], [0.0, 4.0, 0.0]]),
        },
    }
    diagnosis = diagnose(setup, [record(effects)], ["touched"])
    assert diagnosis.verdict == "explained"
    named = {cause.effect: cause for cause in diagnosis.causes}
    assert set(named) == {"tool_com", "contact"}
    assert len(named["contact"].parameters["start"]) == 2


@pytest.mark.slow
def test_presses_that_last_for_a_third_of_a_log_are_contact(setup, record):
    start, force = np.array([3.0, 7.0, 11.5]), np.array([[3.0, 1.0, 2.0], [0.0, 4.0, -1.0], [-2.0, 0.0, 3.0]])
    effects = {"contact": {"start": start, "end": start + np.array([2.6, 2.9, 2.2]), "force": force}}
    diagnosis = diagnose(setup, [record(effects)], ["pressed"])
    assert [cause.effect for cause in diagnosis.causes] == ["contact"]
    assert not diagnosis.terms
    np.testing.assert_allclose(diagnosis.causes[0].parameters["start"], start, atol=0.2)
    assert diagnosis.gap.shrink > 0.95


@pytest.mark.slow
@pytest.mark.parametrize("chatter", [0.0, 1.0])
def test_a_long_press_is_contact_and_grinding_neither_vibration_nor_noise(setup, record, chatter):
    log, rng = record(None), np.random.default_rng(4)
    t = np.asarray(log.t) - log.t[0]
    force = np.array([4.0, 3.0, -11.0]) * (1 + 0.1 * np.sin(2 * np.pi * 0.3 * t))[:, None]
    force = force + chatter * (np.sin(2 * np.pi * 41.0 * t)[:, None] + rng.normal(size=force.shape))
    pushed = np.hstack([force, 0 * force]) * ((t > 4) & (t < 11))[:, None]
    diagnosis = diagnose(setup, [log._replace(wrench=log.wrench + pushed)], ["pressed"])
    assert {cause.effect for cause in diagnosis.causes} <= {"contact"}
    assert diagnosis.gap.shrink > 0.9
    said = [cause.statement for cause in diagnosis.causes] + [term.resembles[0] for term in diagnosis.terms]
    assert len(said) == 1
    assert said[0].startswith(("something pushed the tool once", "something that touches the tool"))


@pytest.mark.slow
def test_without_its_name_in_the_catalogue_the_gap_is_not_explained_away(setup, record):
    log = record({"tool_mass": {"mass": jnp.array(0.96)}})
    withheld = ("tool_mass", "gain", "crosstalk")
    diagnosis = diagnose(setup, [log], ["heavy"], without=withheld)
    assert diagnosis.verdict in ("unknown", "partly_explained")
    assert not {cause.effect for cause in diagnosis.causes} & set(withheld)
    assert {name for name, _ in diagnosis.not_tested} >= set(withheld)


@pytest.mark.slow
def test_a_log_that_is_touched_all_along_shows_nothing_else(setup, record):
    log = record(None)
    walk = np.random.default_rng(0).normal(size=(len(log.t), 3)).cumsum(0) * np.sqrt(log.t[1])
    force = 10.0 + 8.0 * walk
    push = np.concatenate([force, np.cross([0.0, 0.05, 0.1], force)], 1)
    found = diagnose(setup, [log._replace(wrench=log.wrench - push)])
    assert (found.verdict, found.causes, found.terms) == ("unknown", (), ())
    assert found.sentence.startswith("Something touches the tool from 0 to 20.0 s: no free motion")
    assert len(found.sentence.split()) <= 40


@pytest.mark.slow
def test_a_prediction_that_is_no_number_is_not_a_perfect_one(setup, record):
    """NaN counts as missing in a filter, but must count as impossible in a fit."""
    problem, _ = make_problem(setup, [record(None)])
    place = layout(7).of_effect("tool_mass")[0]
    broken = Hypothesis("tool_mass", (int(place),), (float("nan"),))
    nominal = base(problem)
    assert fit(problem, (broken,), nominal).log_likelihood == -np.inf
    assert np.isfinite(nominal.log_likelihood)


def test_a_stated_bias_is_taken_off_before_the_fits(setup, record):
    """A filter that starts at the stated bias has the same innovations whatever the bias is."""
    level, drift = np.arange(1.0, 7.0), np.full(6, 0.1)
    log = record(None)
    stated = replace(setup, bias=replace(setup.bias, initial=level, initial_drift=drift))
    biased = log._replace(wrench=log.wrench - level - drift * log.t[:, None])
    one, other = (base(make_problem(*pair)[0]).error for pair in ((setup, [log]), (stated, [biased])))
    np.testing.assert_allclose(one, other, atol=1e-6)


@pytest.mark.slow
def test_two_logs_of_one_robot_share_the_tool(setup, record):
    """The mass is wrong in both logs; it is reported once, with the error of both, and beside it for each log."""
    log = record({"tool_mass": {"mass": jnp.array(0.96)}})
    diagnosis = diagnose(setup, [log, log], ["one", "other"])
    assert diagnosis.causes[0].effect == "tool_mass"
    assert [one.name for one in diagnosis.by_log] == ["one", "other"]
    shared = diagnosis.causes[0]
    assert abs(shared.parameters["mass"] - 0.96) < 3 * shared.stderr["mass"]
    for one in diagnosis.by_log:
        assert abs(one.parameters["tool_mass"]["mass"] - 0.96) < 3 * one.stderr["tool_mass"]["mass"]
        assert one.stderr["tool_mass"]["mass"] > shared.stderr["mass"] > FORM_ERROR * (0.96 - 0.9)
        assert one.after_sigmas < 1.05 < one.before_sigmas


@pytest.mark.slow
def test_two_logs_of_different_tools_do_not_share_one(setup, record):
    logs = [record({"tool_mass": {"mass": jnp.array(mass)}}) for mass in (0.96, 1.3)]
    diagnosis = diagnose(setup, logs, ["one", "other"])
    assert diagnosis.verdict == "partly_explained"
    assert diagnosis.sentence.startswith("The logs do not share one")
    assert diagnosis.sentence.endswith("do not apply this.")


@pytest.mark.slow
def test_a_torque_is_found_though_the_joint_error_of_a_heavy_tool_may_hide_it(setup):
    """The smoother states several times the error that joints in smooth motion have."""
    heavy = replace(setup, tool=replace(setup.tool, mass=8.0, inertia=8 * setup.tool.inertia))
    log = simulate(heavy, duration=40, rate=100, seed=3).log
    healthy = diagnose(heavy, [log], ["healthy"])
    assert (healthy.verdict, healthy.terms) == ("none", ())
    wrench = np.array(log.wrench)
    wrench[:, 3] += 1.3 * heavy.sensor.noise_std[3] * np.sin(2.9 * np.asarray(log.q)[:, 4])
    diagnosis = diagnose(heavy, [log._replace(wrench=wrench)], ["hidden"])
    assert diagnosis.verdict == "described"
    assert diagnosis.terms[0].drive == "joint_angle"
