"""Causes that fit, but may nevertheless be something else."""

from types import SimpleNamespace

import numpy as np
import pytest

from ftbias_jax.diagnosis.evidence import causes, estimates
from ftbias_jax.diagnosis.evidence.causes import UNDETERMINED, doubt_by, doubt_of
from ftbias_jax.diagnosis.hypothesis import Event, Hypothesis, Shaped
from ftbias_jax.diagnosis.proposals import entries, pulls
from ftbias_jax.diagnosis.proposals.entries import ARMS, ROTATIONS, Whole, nearest, size_of_entries
from ftbias_jax.diagnosis.regression.design_matrix import Columns
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.terms.grid import make_term
from ftbias_jax.model.effects.catalogue import CATALOGUE


@pytest.fixture(autouse=True)
def certain(monkeypatch):
    """Made-up fits have no standard errors."""
    monkeypatch.setattr(causes, "departs", lambda *given: True)


SIZE = size_of_entries(CATALOGUE["crosstalk"])
OFF = ~np.eye(6, dtype=bool)
PROBLEM = SimpleNamespace(catalogue=CATALOGUE)


def leaks_of_a_turn(vector):
    """R^T for force and torque alike, in typical departures, with R by Rodrigues' formula."""
    angle = np.linalg.norm(vector)
    x, y, z = np.asarray(vector) / angle
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    R = np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
    return np.kron(np.eye(2), R.T) * OFF


def in_typical_departures(drawn):
    """(6, 6) crosstalk matrix of 30 numbers."""
    matrix = np.zeros((6, 6))
    matrix[OFF] = drawn
    return matrix * SIZE


def test_the_leaks_of_a_small_turn_are_known_as_one():
    rotation, share = nearest(ROTATIONS, leaks_of_a_turn([0.01, -0.02, 0.005]), SIZE, np.eye(30))
    np.testing.assert_allclose(rotation, [0.01, -0.02, 0.005], atol=5e-4)
    assert share > 0.99


def test_the_leaks_of_another_lever_arm_are_known_as_one():
    arm, force = np.array([0.01, -0.02, 0.005]), np.array([3.0, -1.0, 2.0])
    leaks = np.zeros((6, 6))
    leaks[3:, :3] = np.cross(arm, np.eye(3)).T
    np.testing.assert_allclose(leaks[3:, :3] @ force, np.cross(arm, force))
    found, share = nearest(ARMS, leaks, SIZE, np.eye(30))
    np.testing.assert_allclose(found, arm, atol=1e-12)
    assert share > 0.99
    assert nearest(ROTATIONS, leaks, SIZE, np.eye(30))[1] < 0.01


def test_leaks_that_the_log_does_not_determine_do_not_count():
    leaks = leaks_of_a_turn([0.01, -0.02, 0.005])
    known = np.arange(30) % 2 == 0
    leaks += in_typical_departures(np.where(known, 0.0, 5.0))
    rotation, share = nearest(ROTATIONS, leaks, SIZE, np.diag(np.where(known, 1.0, 1e-9)))
    np.testing.assert_allclose(rotation, [0.01, -0.02, 0.005], atol=5e-4)
    assert share > 0.99


def test_leaks_drawn_at_random_are_hardly_a_turn_or_an_arm():
    rng = np.random.default_rng(0)
    drawn = [in_typical_departures(rng.normal(size=30)) for _ in range(200)]
    for made in (ROTATIONS, ARMS):
        shares = [nearest(made, leaks, SIZE, np.eye(30))[1] for leaks in drawn]
        assert np.mean(shares) == pytest.approx(0.1, abs=0.02)
        assert max(shares) < entries.LIKE_A_ROTATION


A_TURN = (leaks_of_a_turn([0.02, 0, 0]) / np.where(OFF, SIZE, 1))[OFF]
AN_ARM = np.zeros((6, 6))
AN_ARM[3:, :3] = np.cross([0.0, 0.0, 0.03], np.eye(3)).T
AN_ARM = (AN_ARM / np.where(OFF, SIZE, 1))[OFF]


@pytest.mark.parametrize(
    ("leaks", "beside", "of_gains", "words"),
    [
        (A_TURN, "tool_com", 0.0, "a rotation by (1.15, 0.00, 0.00) degrees"),
        (A_TURN, "mount_rotation", 0.0, ""),
        (AN_ARM, "mount_rotation", 0.0, "a lever arm of (0, 0, 0.03) m"),
        (AN_ARM, "tool_com", 0.0, ""),
        (np.arange(30.0), "gain", 0.0, ""),
        (np.arange(30.0), "gain", 0.99, "wrong gains of channels"),
    ],
)
def test_crosstalk_that_makes_up_a_turn_an_arm_or_gains_is_doubtful(monkeypatch, leaks, beside, of_gains, words):
    monkeypatch.setattr(entries, "share_of_gains", lambda *given: of_gains)
    whole = Hypothesis("crosstalk", tuple(range(30)))
    columns = Columns(*np.zeros((2, 0, 1, 6)))
    fitted = Fit((whole,), leaks, np.zeros(0), np.zeros((1, 6)), columns, whole.free, 0.0)
    monkeypatch.setattr(entries, "whole_matrix", lambda *given: Whole(fitted, whole, np.eye(30), True))
    said = doubt_of(PROBLEM, SimpleNamespace(hypotheses=(Hypothesis(beside), whole)), whole)
    assert words in said
    assert bool(said) == bool(words)


@pytest.mark.parametrize(("size", "words"), [(0.05, ""), (0.25, "no sensor leaks so much")])
def test_a_few_leaks_of_a_quarter_are_doubtful(monkeypatch, size, words):
    """A pendulum in the tool looked like that; of a whole matrix they may be that of another sensor."""
    monkeypatch.setattr(entries, "share_of_gains", lambda *given: 0.0)
    whole, few = Hypothesis("crosstalk", tuple(range(30))), Hypothesis("crosstalk", (0,))
    z = np.zeros(30)
    z[0] = size / SIZE[OFF][0]
    columns = Columns(*np.zeros((2, 0, 1, 6)))
    fitted = Fit((whole,), z, np.zeros(0), np.zeros((1, 6)), columns, whole.free, 0.0)
    monkeypatch.setattr(entries, "whole_matrix", lambda *given: Whole(fitted, whole, np.eye(30), False))
    found = SimpleNamespace(hypotheses=(Hypothesis("mount_rotation"), Hypothesis("tool_com"), few), z=z)
    said = doubt_of(PROBLEM, found, few)
    assert words in said
    assert bool(said) == bool(words)


@pytest.mark.parametrize("force_alone", [False, True])
def test_leaks_are_gains_where_force_and_torque_go_together(monkeypatch, force_alone):
    rng = np.random.default_rng(0)
    force = rng.normal(size=(200, 3))
    torque = rng.normal(size=(200, 3)) if force_alone else np.cross([0.0, 0.0, 0.1], force)
    load = np.concatenate([force, torque], 1)
    leaked = np.zeros((200, 6))
    leaked[:, 0] = 0.5 * torque[:, 1]
    monkeypatch.setattr(entries, "with_and_without", lambda problem, z, free: np.stack([load + leaked, load]))
    monkeypatch.setattr(entries, "whitened", lambda problem, columns: columns)
    found = SimpleNamespace(z=np.ones(4))
    share = entries.share_of_gains(PROBLEM, found, Hypothesis("crosstalk", (0, 1)))
    assert (share < 0.1) if force_alone else (share > 0.99)


@pytest.mark.parametrize(
    ("anchor", "rest_length", "stderr", "words"),
    [
        ([0.5, 0.0, 0.8], 0.3, 0.1, ""),
        ([0.5, 0.0, 0.8], 0.3, 1.5, "its length and anchor are not determined"),
        ([0.5, 0.0, 0.8], 2.5, 0.1, "such a cable is not plausible"),
        ([0.0, 0.0, -6.0], 0.3, 0.1, "such a cable is not plausible"),
    ],
)
def test_a_cable_of_metres_or_anywhere_is_told_as_its_force(monkeypatch, anchor, rest_length, stderr, words):
    values = {"anchor": anchor, "rest_length": rest_length}
    errors = {"anchor": [0.05, stderr, 0.05], "rest_length": 0.05}
    monkeypatch.setattr(pulls, "parameters", lambda *given: (values, errors))
    monkeypatch.setattr(pulls, "equivalent_force", lambda *given: (np.array([1.0, -2.0, 0.5]), 0.25))
    model = SimpleNamespace(arm=SimpleNamespace(zero_position=np.array([0.1, 0.0, 0.8])))
    problem = SimpleNamespace(catalogue=CATALOGUE, parts=[SimpleNamespace(signals=SimpleNamespace(model=model))])
    said = doubt_of(problem, None, Hypothesis("cable"))
    assert words in said
    assert bool(said) == bool(words)
    if words:
        assert "(1, -2, 0.5) N in base axes on the tool, varying by 0.25 N" in said


@pytest.mark.parametrize(("length", "doubtful"), [(1.0, False), (4.0, True)])
def test_a_contact_that_lasts_is_doubtful(length, doubtful):
    h = Hypothesis("contact", detail=(Shaped(Event(0, 5.0, 5.0 + length), 4),), local=True)
    assert bool(doubt_of(PROBLEM, None, h)) == doubtful
    assert doubt_of(PROBLEM, None, Hypothesis("tool_mass")) == ""


@pytest.mark.parametrize(("stderr", "certain"), [(0.4, True), (0.6, False)])
def test_a_cause_without_a_certain_number_is_doubtful(monkeypatch, stderr, certain):
    values = {"gain": [1.02, 1.0, 1.0, 1.0, 1.0, 1.0]}
    errors = {"gain": [0.02 * stderr, *[0.01] * 5]}
    monkeypatch.setattr(estimates, "parameters", lambda *given: (values, errors))
    assert estimates.departs(PROBLEM, None, Hypothesis("gain")) == certain
    monkeypatch.setattr(causes, "departs", estimates.departs)
    monkeypatch.setattr(causes.curves, "doubt", lambda *given: "")
    assert doubt_of(PROBLEM, None, Hypothesis("gain")) == ("" if certain else UNDETERMINED)


@pytest.mark.parametrize(("force", "certain"), [(15.0, False), (500.0, True)])
def test_an_event_is_certain_if_any_force_is(monkeypatch, force, certain):
    errors = {"force": [[238.0, 214.0, 251.0], [200.0, 200.0, 200.0]]}
    monkeypatch.setattr(
        estimates, "parameters", lambda *given: ({"force": [[-15.0, 3.0, -7.0], [force, 0, 0]]}, errors)
    )
    assert estimates.departs(PROBLEM, None, Hypothesis("contact")) == certain


def test_terms_that_do_as_well_are_told_by_their_drives():
    terms = [make_term(drive, "linear", "base", "force") for drive in ("velocity", "position", "velocity")]
    assert doubt_by(terms).endswith("a term does as well (drive: velocity, position)")
    assert doubt_by([]) == ""
