"""What a log of the sensor's pose cannot determine, and which values the drives of terms get from it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from stated import PANDA, pose_setup

from ftbias_jax.errors import SetupError
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.model.effects.terms.columns import state_of
from ftbias_jax.model.effects.types import Model, Signals
from ftbias_jax.model.kinematics.recorded_pose import body_motion
from ftbias_jax.model.own_effects import check_observable, unobservable_effects
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.setup import parse_setup


def test_an_arm_shows_everything():
    setup = parse_setup(PANDA)
    assert unobservable_effects(setup) == {}
    check_observable({"cable": {}, "encoder_offset": {}}, setup)


def test_effects_of_joints_and_of_accelerations_are_not_shown_by_an_orientation():
    turning, moving = (pose_setup(linear=linear) for linear in ("none", "position"))
    assert set(unobservable_effects(moving)) == {"encoder_offset", "joint_flexibility", "cable"}
    assert set(unobservable_effects(turning)) - set(unobservable_effects(moving)) == {
        "tool_flexibility",
        "tool_inertia",
        "mount_translation",
    }
    check_observable({"gain": {}, "tool_flexibility": {}}, moving)
    own = CATALOGUE["gain"]._replace(name="friction", needs_motion="joints")
    assert "friction" in unobservable_effects(moving.with_effects([own]))


@pytest.mark.parametrize(
    "term", [{"drive": "joint_angle", "frame": "sensor"}, {"drive": "constant", "frame": "joint", "joint": 1}]
)
def test_terms_of_joints_are_refused(term):
    setup = pose_setup()
    check_observable({"term": [{"drive": "constant", "frame": "base"}]}, setup)
    with pytest.raises(SetupError, match=r"effects\.term: does not go with"):
        check_observable({"term": [term]}, setup, prefix="effects.")


def moving(count=30):
    """Signals of a recorded pose with random states."""
    setup = pose_setup()
    params = params_from_setup(setup)
    q, dq, ddq = (jnp.asarray(x) for x in np.random.default_rng(0).normal(size=(3, count, 7)))
    t = jnp.arange(count, dtype=float)
    return Signals(t, q, dq, ddq, jnp.zeros(count), Model(params.arm, params.gravity, params.theta))


def test_terms_see_the_sensor_move_and_no_joints():
    signals = moving()
    state = state_of(jnp, signals, jnp.zeros((30, 6)))
    each = jax.vmap(lambda *x: body_motion(signals.model.arm, *x))(signals.q, signals.dq, signals.ddq)
    np.testing.assert_allclose(state.velocity, each.linear_velocity, atol=1e-12)
    assert state.q.shape == state.dq.shape == (30, 0)
    assert state.axes.shape == (30, 0, 3)
