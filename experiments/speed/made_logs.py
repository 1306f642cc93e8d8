"""Logs for timing: many short ones or a long one of the demonstration's arm, at 1 kHz, and its parameters."""

import common
import jax
import jax.numpy as jnp

RATE = 1e-3  # s
PARAMS = common.PARAMS._replace(joint=common.PARAMS.joint._replace(process_density=jnp.full(7, 30.0)))


def make_logs(count, length):
    t = RATE * jnp.arange(length)
    motions = [common.sines(seed, t) for seed in range(count)]
    _, samples = common.simulate_logs(0, count, PARAMS, jax.tree.map(lambda *x: jnp.stack(x), *motions))
    return samples._replace(dt=jnp.full((count, length), RATE).at[:, 0].set(0.0))


def make_log(length):
    """Make one log, without the leading axis."""
    return jax.tree.map(lambda x: x[0], make_logs(1, length))


def cast(tree, dtype):
    return jax.tree.map(lambda x: x.astype(dtype), tree)
