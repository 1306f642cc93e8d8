"""Terms against mechanics written out naively, with NumPy and with JAX."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from stated import PANDA

from ftbias_jax.model.effects.terms.columns import added, at_point, change, columns, count_columns, state_of
from ftbias_jax.model.effects.terms.forms import FORMS
from ftbias_jax.model.effects.terms.types import State, Term
from ftbias_jax.model.effects.types import Signals
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.model.wrench.tool_wrench import Model
from ftbias_jax.setup import parse_setup

POINT = np.array([0.02, -0.03, 0.13])


@pytest.fixture(scope="module")
def signals() -> Signals:
    t = np.linspace(0, 2, 801)
    phase = np.outer(t, np.linspace(0.5, 2.0, 7)) + np.arange(7)
    rate = np.linspace(0.5, 2.0, 7)
    q = np.array([0, -0.5, 0, -2, 0, 1.8, 0.7]) + 0.4 * np.sin(phase)
    params = params_from_setup(parse_setup(PANDA))
    series = (t, q, 0.4 * rate * np.cos(phase), -0.4 * rate**2 * np.sin(phase), 25 + t)
    return Signals(*(jnp.asarray(x) for x in series), Model(params.arm, params.gravity, params.theta))


@pytest.fixture(scope="module")
def state(signals) -> State:
    load = np.outer(np.sin(np.asarray(signals.t)) - 2, [1, 2, 3, 0.1, 0.2, 0.3])
    found = state_of(np, signals, load)
    return State(*(np.asarray(x, float) for x in found))


def a_term(drive, form, frame="base", acts_as="force", joint=0, coefficients=(1.0,), **parameters):
    return Term(drive, form, frame, acts_as, joint, (), parameters, POINT, np.array(coefficients))


def some_term(form) -> Term:
    """A term of any form that uses every column."""
    numbers = {p.name: np.clip(0.7, p.least, p.most) for p in form.parameters}
    frame, acts_as = ("sensor", "wrench") if form.kind == "channels" else ("base", "force")
    joint = 3 if form.drive.startswith("joint") else 0
    term = a_term(form.drive, form.name, frame, acts_as, joint, (), **numbers)
    return Term(**{**vars(term), "coefficients": np.linspace(0.5, 1.5, count_columns(term))})


def test_the_velocity_of_a_point_is_the_slope_of_its_place(state):
    moved = at_point(np, state, POINT)
    slope = np.gradient(moved.position, state.t, axis=0)
    np.testing.assert_allclose(moved.velocity[2:-2], slope[2:-2], atol=2e-4)
    np.testing.assert_allclose(moved.acceleration[2:-2], np.gradient(moved.velocity, state.t, axis=0)[2:-2], atol=3e-3)


def test_a_torque_about_a_joint_is_along_its_axis(state):
    found = change(np, {"1": a_term("joint_velocity", "viscous", "joint", "torque", 7, [0.5])}, state)
    expected = -np.einsum("tji,tj->ti", state.rotation, state.axes[:, 6]) * (-0.5 * state.dq[:, 6:7])
    np.testing.assert_allclose(found[:, 3:], expected, atol=1e-12)
    assert not found[:, :3].any()


def test_a_rotor_resists_by_its_momentum_across_the_rotation(state):
    momentum = np.array([0.0, 0.01, 0.04])
    found = change(np, {"1": a_term("angular_velocity", "gyroscopic", "sensor", "torque", 0, momentum)}, state)
    for k in (0, 400):
        R = state.rotation[k]
        on_tool = -np.cross(R.T @ state.angular_velocity[k], momentum)
        np.testing.assert_allclose(found[k, 3:], -on_tool, atol=1e-12)


def test_a_load_that_is_not_linear_acts_on_its_own_channel(state):
    found = change(np, {"1": a_term("load", "cube", "sensor", "wrench", 0, [0.1, 0, 0, 0, 0, 2.0])}, state)
    np.testing.assert_allclose(found[:, 0], 0.1 * state.load[:, 0] ** 3)
    np.testing.assert_allclose(found[:, 5], 2.0 * state.load[:, 5] ** 3)
    assert not found[:, 1:5].any()


def test_what_is_switched_is_there_from_every_other_time_on(state):
    times = np.array([0.3, 0.9, 1.7])
    found = change(np, {"1": a_term("time", "step", "sensor", "wrench", 0, np.eye(6)[2], time=times)}, state)
    on = [(t >= times).sum() % 2 for t in state.t]
    np.testing.assert_allclose(found[:, 2], -np.array(on, float), atol=1e-12)
    assert not found[:, [0, 1, 3, 4, 5]].any()


def test_a_mean_of_samples_has_the_share_of_what_is_switched_in_its_middle(state):
    of_ten = state._replace(counts=np.full(len(state.t), 10.0), period=np.array(1e-3))
    single = np.mean([(state.t + late >= 0.5) for late in (np.arange(10) - 4.5) * 1e-3], 0)
    term = a_term("time", "step", "sensor", "wrench", 0, np.eye(6)[0], time=np.array(0.5))
    np.testing.assert_allclose(-change(np, {"1": term}, of_ten)[:, 0], single, atol=0.06)


def test_a_load_that_is_carried_weighs_and_resists_at_its_point(state):
    term = a_term("acceleration", "payload", coefficients=[0.4], time=np.array([0.5, 1.5]), takes=np.array(0.2))
    found = change(np, {"1": term}, state)
    moved = at_point(np, state, POINT)
    for k, held in ((100, 0.0), (200, 0.5), (220, 0.75), (400, 1.0), (700, 0.0)):
        force = state.rotation[k].T @ (held * 0.4 * (state.gravity - moved.acceleration[k]))
        np.testing.assert_allclose(found[k], -np.concatenate([force, np.cross(POINT, force)]), atol=1e-9)


def test_drag_in_one_place_ends_beyond_its_radius(state):
    place = at_point(np, state, POINT).position
    middle = dict(zip("xyz", map(np.asarray, place[400]), strict=True))
    numbers = middle | {"radius": np.asarray(0.1), "edge": np.asarray(1e-3)}
    found = change(np, {"1": a_term("velocity", "local", coefficients=[6.0, 0.0], **numbers)}, state)
    everywhere = change(np, {"1": a_term("velocity", "linear", coefficients=[6.0])}, state)
    distance = np.linalg.norm(place - place[400], axis=1)
    assert 100 < (distance > 0.11).sum() < 700
    np.testing.assert_allclose(found[distance < 0.09], everywhere[distance < 0.09], atol=1e-6)
    assert np.abs(found[distance > 0.11]).max() < 1e-6


def test_a_surface_pushes_back_by_its_depth_and_resists_sliding_along_it(state):
    moved = at_point(np, state, POINT)
    normal = np.array([0.6, 0.0, 0.8])
    offset = float(np.median(moved.position @ normal))
    plane = dict(zip("xyz", map(np.asarray, normal), strict=True)) | {"offset": offset, "length": 1e-3}
    found = change(np, {"1": a_term("position", "surface", coefficients=[200.0, 60.0], **plane)}, state)
    depth = moved.position @ normal - offset
    for k in np.argsort(depth)[[0, 100, 700, 800]]:
        along = moved.velocity[k] - (moved.velocity[k] @ normal) * normal
        pressed = max(depth[k], 0.0)
        force = -pressed * (200.0 * normal + 60.0 * along / np.hypot(np.linalg.norm(along), 0.02))
        np.testing.assert_allclose(found[k, :3], -state.rotation[k].T @ force, atol=0.2)


def test_used_columns_are_those_that_are_named(state):
    whole = columns(np, a_term("position", "linear"), state)
    few = Term(**{**vars(a_term("position", "linear")), "used": (1, 5)})
    np.testing.assert_array_equal(columns(np, few, state), whole[:, [1, 5]])


def test_every_form_has_the_columns_it_counts_and_is_the_same_in_jax(state):
    terms = {f"{drive} {name}": some_term(form) for (drive, name), form in FORMS.items()}
    on_jax = jax.jit(lambda terms, state: {n: change(jnp, {"1": x}, state) for n, x in terms.items()})(terms, state)
    for name, term in terms.items():
        assert columns(np, term, state).shape == (len(state.t), count_columns(term), 6), name
        found = change(np, {"1": term}, state)
        np.testing.assert_allclose(on_jax[name], found, rtol=2e-3, atol=2e-3 * np.abs(found).max(), err_msg=name)


@pytest.mark.parametrize("acts_as", ["force", "torque", "wrench"])
def test_what_a_term_adds_is_its_columns_times_its_coefficients(state, acts_as):
    term = a_term("position", "linear", acts_as=acts_as, coefficients=[2.0, -1.0, 0.5])
    term = Term(**{**vars(term), "used": (1, 4, 6)})
    expected = -np.einsum("tkc,k->tc", columns(np, term, state), term.coefficients)
    np.testing.assert_allclose(added(np, term, state), expected, atol=1e-12)
