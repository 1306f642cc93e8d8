import jax
import jax.numpy as jnp
import numpy as np
from numpy.testing import assert_allclose

from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.model.effects.types import motion_of

KEYS = ("t", "q", "dq", "ddq", "temperature")


def test_a_joint_gives_way_by_the_virtual_work_of_a_weight_at_the_sensor(signals):
    """The torque of a weight about a joint is how far the weight sinks when the joint turns by one radian."""
    few = signals._replace(**{key: getattr(signals, key)[:20] for key in KEYS})
    down = np.array(few.model.gravity) / np.linalg.norm(few.model.gravity)
    height = jax.jit(lambda q: motion_of(few._replace(q=q)).sensor_position.T @ down)
    flexible = jax.jit(CATALOGUE["joint_flexibility"].transform)
    for joint in range(1, few.q.shape[1] + 1):
        moved = flexible({"joint": jnp.array(float(joint)), "deflection": jnp.array(0.01)}, few)
        step = 1e-6 * (jnp.arange(1, few.q.shape[1] + 1) == joint)[None]
        sinks = (height(few.q + step) - height(few.q - step)) / 2e-6
        expected = np.zeros(few.q.shape)
        expected[:, joint - 1] = 0.01 * sinks
        assert_allclose(moved.q - few.q, expected, atol=1e-9)
        assert moved.motion is None


def test_several_joints_may_give_way_at_once(signals):
    flexible, n = jax.jit(CATALOGUE["joint_flexibility"].transform), signals.q.shape[1]
    each = [flexible({"joint": jnp.array(k + 1.0), "deflection": jnp.array(0.01 * k)}, signals).q for k in range(n)]
    both = flexible({"joint": jnp.arange(1.0, n + 1), "deflection": 0.01 * jnp.arange(n)}, signals).q
    assert_allclose(both - signals.q, sum(each) - n * signals.q, atol=1e-12)
    assert np.abs(both - signals.q).max() > 1e-3
