"""A crosstalk matrix beside a tool: a few entries if these suffice, all entries if they are worth their parameters."""

from dataclasses import replace

import numpy as np
import pytest

from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.diagnosis import tool_first
from ftbias_jax.diagnosis.candidates import Scored, score
from ftbias_jax.diagnosis.diagnose import diagnose
from ftbias_jax.diagnosis.evidence.estimates import FORM_ERROR, parameters
from ftbias_jax.diagnosis.hypothesis import at_values
from ftbias_jax.diagnosis.problem import make_problem
from ftbias_jax.diagnosis.proposals.entries import evidence, whole_matrix
from ftbias_jax.diagnosis.regression.chain_model import to_values
from ftbias_jax.diagnosis.regression.fit import base, covariance, fit
from ftbias_jax.diagnosis.thresholds import ENTRY_STD, PENALTY_PER_PARAMETER
from ftbias_jax.diagnosis.tool_first import Searched, with_tool
from ftbias_jax.model.simulate_log import simulate
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.setup import parse_setup

TRUE = parse_setup(SETUP)
OFF = replace(TRUE, tool=replace(TRUE.tool, center_of_mass=TRUE.tool.center_of_mass + np.array([0.006, 0.0, -0.008])))
ONE = np.eye(6)
ONE[2, 4] = 3.0
ALL = np.eye(6) + 0.08 * np.kron([[1, 15], [0.1, 1]], np.ones((3, 3))) * (1 - np.eye(6))


def fitted(matrix):
    """The problem of a log with this matrix and a wrong centre of mass, and its fit with only the largest entry."""
    log = simulate(TRUE, {"crosstalk": {"matrix": matrix}}, duration=20, rate=100, seed=12).log
    problem, _ = make_problem(OFF, [log])
    of_tool = with_tool(problem, base(problem))
    few = at_values(problem, problem.catalogue["crosstalk"], matrix=ONE)
    largest = [(i, x) for i, x in zip(few.free, few.start, strict=True) if x]
    few = few._replace(free=tuple(i for i, _ in largest), start=tuple(x for _, x in largest))
    found = fit(problem, (*of_tool.hypotheses, few), of_tool)
    return problem, found, few, next(h for h in found.hypotheses if h.effect == "tool_com")


@pytest.fixture(scope="module")
def one_leak():
    return in_float64(fitted)(ONE)


def values(problem, z, effect):
    signals = problem.parts[0].signals
    return to_values.prepare(signals, z, catalogue=problem.catalogue)(signals, z)[effect]


@in_float64
def test_one_leak_is_told_as_one_and_leaves_the_tool_right(one_leak):
    problem, found, few, center = one_leak
    whole = whole_matrix(problem, found, few)
    assert not whole.worth_its_parameters
    told, stderr = parameters(problem, found, few)
    np.testing.assert_allclose(told["matrix"], values(problem, found.z, "crosstalk")["matrix"])
    stderr = np.array(stderr["matrix"])
    assert (stderr[~np.eye(6, dtype=bool)] > 0).all()  # including those of entries that are not reported
    assert abs(told["matrix"][2][4] - 3.0) < 3 * stderr[2, 4]
    told, stderr = parameters(problem, found, center)
    np.testing.assert_array_less(
        np.abs(told["center_of_mass"] - TRUE.tool.center_of_mass), 3 * np.array(stderr["center_of_mass"])
    )
    apart = values(problem, whole.fit.z, "tool_com")["center_of_mass"] - np.array(told["center_of_mass"])
    wider = parameters(problem, found, center, either=True)[1]["center_of_mass"]
    np.testing.assert_allclose(wider, np.hypot(stderr["center_of_mass"], apart), rtol=1e-9)


@in_float64
def test_leaks_of_all_channels_are_told_as_all():
    problem, found, few, _ = fitted(ALL)
    whole = whole_matrix(problem, found, few)
    assert whole.worth_its_parameters
    told, stderr = (np.array(x["matrix"]) for x in parameters(problem, found, few))
    np.testing.assert_allclose(told, values(problem, whole.fit.z, "crosstalk")["matrix"])
    off = ~np.eye(6, dtype=bool)
    assert (np.abs(told - ALL)[off] < 3 * stderr[off]).mean() > 0.9
    before = Searched(base(problem), found, [[Scored(found, 0.0)], [Scored(found, 0.0)], [Scored(found, 0.0)], []])
    closed = before._replace(accepted=found._replace(error=np.zeros_like(found.error)))
    assert tool_first._with_all_entries(problem, closed) is closed
    after = tool_first._with_all_entries(problem, before)
    assert after.accepted.log_likelihood == whole.fit.log_likelihood
    assert [len(scored) for scored in after.rounds] == [1, 1, 1, 0]


@in_float64
def test_a_matrix_is_paid_by_what_the_log_says_of_it_and_large_leaks_are_unlikely():
    """Crosstalk that mimics a wrong centre of mass fits as well, but is larger than that beside the right one."""
    problem, found, few, _ = fitted(ALL)
    nominal = base(problem)
    assert evidence(problem, nominal) == nominal.log_likelihood
    beside, alone = (whole_matrix(problem, one, few).fit for one in (found, fit(problem, (few,), nominal)))
    for one in (beside, alone):
        entries = list(next(h.free for h in one.hypotheses if h.effect == "crosstalk"))
        place = [one.free.index(i) for i in entries]
        of_entries = covariance(problem, one)[np.ix_(place, place)]
        size = (one.z[entries] ** 2).sum() / ENTRY_STD**2 / 2
        surer = -np.log(np.linalg.eigvalsh(of_entries) / ENTRY_STD**2).sum() / 2
        others = PENALTY_PER_PARAMETER * (one.degrees - len(entries))
        np.testing.assert_allclose(evidence(problem, one), one.log_likelihood - size - surer - others)
    assert evidence(problem, beside) - evidence(problem, alone) > score(beside, alone)


def test_leaks_of_all_channels_explain_a_log_without_terms():
    """Few of thirty entries leave a residual, which is no reason to describe the whole gap by something else."""
    matrix = np.eye(6) + np.random.default_rng(2).normal(size=(6, 6)) * 0.1 * (ALL - np.eye(6)) / 0.08
    quiet = replace(TRUE, sensor=replace(TRUE.sensor, noise_std=TRUE.sensor.noise_std / 5))
    log = simulate(quiet, {"crosstalk": {"matrix": matrix}}, duration=20, rate=100, seed=12).log
    diagnosis = diagnose(quiet, [log])
    assert (diagnosis.verdict, [cause.effect for cause in diagnosis.causes]) == ("explained", ["crosstalk"])
    assert diagnosis.gap.after_sigmas < 1.01
    cause = diagnosis.causes[0]
    off = np.abs(np.array(cause.parameters["matrix"]) - matrix) / np.maximum(cause.stderr["matrix"], 1e-12)
    assert (off[~np.eye(6, dtype=bool)] < 3).mean() > 0.9


@pytest.mark.slow
def test_leaks_of_all_channels_do_not_take_the_place_of_a_wrong_tool():
    matrix = np.eye(6) + np.random.default_rng(4).normal(size=(6, 6)) * 0.03 * (ALL - np.eye(6)) / 0.08
    heavy = replace(TRUE, tool=replace(TRUE.tool, mass=1.14 * TRUE.tool.mass))
    log = simulate(TRUE, {"crosstalk": {"matrix": matrix}}, duration=30, rate=100, seed=12).log
    found = {cause.effect: cause for cause in diagnose(heavy, [log]).causes}
    assert {"crosstalk", "tool_mass"} <= found.keys()
    mass, stderr = (x["mass"] for x in (found["tool_mass"].parameters, found["tool_mass"].stderr))
    assert abs(mass - TRUE.tool.mass) < 3.5 * stderr


@in_float64
def test_what_a_form_may_put_into_a_vector_has_no_direction(one_leak):
    problem, _, _, center = one_leak
    found = base(problem)._replace(hypotheses=(center,), free=center.free)
    sure = np.zeros((3, *found.error.shape))
    sure[range(3), range(3), 0] = 1e6
    z = found.z.copy()
    z[center.free[0]] = 2.0
    found = found._replace(z=z, columns=found.columns._replace(moving=sure))
    (stderr,) = parameters(problem, found, center)[1].values()
    np.testing.assert_allclose(stderr, 2.0 * 0.006 * FORM_ERROR, rtol=1e-2)  # 6 mm is a typical departure
