"""Rules by which terms are refused, on synthetic motions."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from made_states import still_state
from scipy.spatial.transform import Rotation

from ftbias_jax.diagnosis.terms import select
from ftbias_jax.diagnosis.terms.fit_terms import Solved
from ftbias_jax.diagnosis.terms.grid import make_term
from ftbias_jax.diagnosis.terms.select import Search, _merit, _order, cancels, is_gain_too, is_lifted
from ftbias_jax.model.effects.terms.columns import count_columns


@pytest.mark.parametrize(
    ("swing", "coefficients", "refused"),
    [
        (1.0, [2.0, 1.0, 0.5], False),  # whole workspace: parts of equal size
        (1e-3, [2.0, 0.0, 0.0], False),  # little motion, one part
        (
            1e-3,
            [-2.0e4, 1.0e4, 0.0],
            True,
        ),  # q^2 - 2 q is flat at one radian
    ],
)
def test_parts_that_cancel_are_no_description(swing, coefficients, refused):
    q = 1 + swing * np.sin(np.linspace(0, 6, 200))
    term = replace(make_term("joint_angle", "cubic", "joint", "torque", 1), coefficients=np.array(coefficients))
    assert count_columns(term) == 3
    assert cancels(term, still_state(q, np.zeros((200, 3)))) == refused


def test_a_far_spring_on_a_robot_that_moves_a_little_is_one():
    rng = np.random.default_rng(0)
    position = [0.5, 0.2, 0.4] + 0.03 * rng.normal(size=(200, 3))
    pull = np.array([100.0, -50.0, 100.0, -40.0])
    term = replace(make_term("position", "spring", "base", "force"), coefficients=pull)
    assert not cancels(term, still_state(rng.normal(size=200), position))


@pytest.mark.parametrize(("ahead", "first"), [(1.0, "frequency"), (100.0, "time")])
def test_of_a_wave_and_a_line_that_do_the_same_the_line_comes_first(ahead, first):
    error, none = np.zeros((1, 6)), np.zeros((0, 1, 6))
    wave, line = (
        (merit, Solved((make_term(*form, "sensor", "wrench"),), error, 0.0, none, np.zeros(0)))
        for merit, form in ((1e4 + ahead, ("time", "wave")), (1e4, ("frequency", "line")))
    )
    assert sorted([wave, line], key=_order)[0][1].terms[0].drive == first


@pytest.mark.parametrize(
    ("drive", "form", "share", "told"),
    [
        ("time", "wave", 0.5, False),
        ("time", "wave", 3.0, True),
        ("frequency", "line", 0.5, False),
        ("velocity", "linear", 0.5, True),
    ],
)
def test_a_wave_of_the_bias_is_told_only_if_it_is_a_share_of_all_that_was_missing(
    monkeypatch, drive, form, share, told
):
    """Beside a found cause the rest is small, and the filter's bias follows what changes slowly in it."""
    search = object.__new__(Search)
    search.problem, search.base = SimpleNamespace(), "with the cause"
    step = SimpleNamespace(share=share, described=SimpleNamespace(terms=(make_term(drive, form, "sensor", "wrench"),)))
    of_fit = {"nothing": 1.0, "with the cause": 0.1}
    monkeypatch.setattr(select, "fit_of_nothing", lambda problem: "nothing")
    monkeypatch.setattr(select, "enough", lambda problem, fit: of_fit[fit])
    monkeypatch.setattr(select, "least_beside_joints", lambda problem: 0.0)
    monkeypatch.setattr(select, "gap_of", lambda problem, fit: 0.0)
    monkeypatch.setattr(Search, "_step", lambda *_: step)
    step.described.fit = None
    assert len(search.grow(None, [None])) == told


@pytest.mark.parametrize(("fast", "same"), [(0.0, True), (20.0, False)])
def test_a_field_is_a_gain_of_one_sign_too_in_slow_motion(fast, same):
    """The weight as load along each axis, against a force along z with its strength."""
    rng = np.random.default_rng(0)
    turn = Rotation.random(400, rng=rng).as_matrix()
    gravity = np.array([0.0, 0.0, -9.81])
    state = still_state(rng.normal(size=400), np.zeros((400, 3)))
    load = np.zeros((400, 6))
    load[:, :3] = -turn.transpose(0, 2, 1) @ gravity + fast * rng.normal(size=(400, 3))
    state = state._replace(rotation=turn, gravity=gravity, load=load)
    term = make_term("orientation", "linear", "sensor", "wrench")
    up = replace(term, coefficients=np.eye(3, 6)[[2, 0, 1]].ravel() * 0.02)
    own = replace(term, coefficients=np.eye(3, 6).ravel() * 0.02)
    assert is_gain_too(own, state, np.full(6, 0.1)) == same
    assert not is_gain_too(up, state, np.full(6, 0.1))
    assert not is_gain_too(replace(own, drive="position"), state, np.full(6, 0.1))


def test_times_are_numbers_so_what_turns_back_as_often_explains_as_much_by_less():
    """A measured case: a seal rubs in a joint that reverses 23 times, against a torque that is switched as often."""
    switched = make_term("time", "step", "sensor", "wrench", 0, {"time": np.arange(23.0)})
    rubbing = make_term("joint_velocity", "friction", "joint", "torque", 7, {"speed": np.asarray(0.02)})
    found = [
        (_merit(gain, one), Solved((one,), np.zeros((1, 6)), gain, np.zeros((1, 1, 6)), np.zeros(0)))
        for gain, one in ((527_538.0, switched), (526_000.0, rubbing))
    ]
    assert min(found, key=_order)[1].terms == (rubbing,)


@pytest.mark.parametrize(
    ("times", "mass", "lifted"),
    [([3.0, 5.0], -0.7, True), ([3.0, 5.0], 0.7, False), ([3.0, 5.0, 9.0], -0.7, False), ([0.0, 5.0], -0.7, False)],
    ids=["pushed up", "carried", "put down in the end", "put down at first"],
)
def test_a_load_of_less_than_nothing_is_a_push(times, mass, lifted):
    numbers = {"time": np.array(times), "takes": np.array(0.1)}
    term = replace(make_term("acceleration", "payload", "base", "force", 0, numbers), coefficients=np.array([mass]))
    assert is_lifted(term) is lifted
    step = make_term("time", "step", "base", "force", 0, {"time": np.array(times)})
    assert not is_lifted(replace(step, coefficients=np.array([0.0, 0.0, mass])))
