"""Vibration, correlated noise, a drift that reverts, and the gate: the fast route is the definition."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.filtering import pipeline
from ftbias_jax.filtering.pipeline import Options

PARTS = {
    "vibration": {"vibration": 0.3 * np.ones((1, 6))},
    "a drift that reverts": {"drift_time": np.linspace(0.3, 5, 6)},
    "correlated noise": {"correlated_std": np.linspace(0.02, 0.2, 6), "correlated_time": np.linspace(0.02, 1, 6)},
    "all": {
        "vibration": 0.3 * np.ones((1, 6)),
        "drift_time": np.linspace(0.3, 5, 6),
        "correlated_std": np.linspace(0.02, 0.2, 6),
        "correlated_time": np.linspace(0.02, 1, 6),
        "correlated_vibration": np.linspace(0, 1, 6),
    },
}
parts = pytest.mark.parametrize("part", PARTS)
gates = pytest.mark.parametrize("gate", [None, 4.0])


def with_part(params, part):
    n = params.joint.process_density.shape[0]
    values = {key: jnp.asarray(x) for key, x in PARTS[part].items()}
    if "vibration" in values:
        values["vibration"] = values["vibration"] * jnp.linspace(0.5, 2, n)[:, None]
    return params._replace(bias=params.bias._replace(**values))


def touched(samples):
    """The log with a contact, for the gate to close."""
    wrench = np.array(samples.wrench)
    wrench[20:26] += 30.0
    return samples._replace(wrench=jnp.asarray(wrench))


@pytest.mark.parametrize(("part", "gate"), [*((part, None) for part in PARTS), ("all", 4.0)])
def test_the_fast_route_is_the_definition(params, samples, part, gate):
    options, moved, log = Options(gate=gate), with_part(params, part), touched(samples)
    start = pipeline.init(moved, log)
    fast, slow = (run(moved, start, log, options, pipeline.keep_all) for run in (pipeline.run, pipeline.scan_steps))
    for (path, x), y in zip(jax.tree.leaves_with_path(fast), jax.tree.leaves(slow), strict=True):
        largest = np.nanmax(np.abs(y), initial=1e-9)
        np.testing.assert_allclose(x, y, rtol=0, atol=1e-10 * largest, err_msg=jax.tree_util.keystr(path))
    used = np.isfinite(np.asarray(fast[1][1].wrench.value)).any(1)
    assert used[20:26].any() == (gate is None)


@pytest.mark.slow
@gates
@parts
def test_so_is_its_gradient(params, samples, part, gate):
    """With respect to all parameters of the bias filter; what does not pass the gate is taken as given."""
    options, moved, log = Options(gate=gate), with_part(params, part), touched(samples)

    def nats(run, bias):
        params = moved._replace(bias=bias)
        return run(params, pipeline.init(params, log), log, options, lambda state, info: info.log_likelihood)[1].sum()

    fast, slow = (jax.jit(jax.grad(partial(nats, run)))(moved.bias) for run in (pipeline.run, pipeline.scan_steps))
    for (path, x), y in zip(jax.tree.leaves_with_path(fast), jax.tree.leaves(slow), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-7, atol=1e-8 * np.abs(y).max(), err_msg=jax.tree_util.keystr(path))


def test_a_drift_that_reverts_slowly_never_does(params, samples):
    """In the limit of long times, and of short correlation times, the parts leave the plain filter."""
    slow = params._replace(bias=params.bias._replace(drift_time=jnp.full(6, 1e9)))
    for name, x, y in zip(
        ("mean", "covariance"),
        pipeline.run(slow, pipeline.init(slow, samples), samples)[0].bias,
        pipeline.run(params, pipeline.init(params, samples), samples)[0].bias,
        strict=True,
    ):
        np.testing.assert_allclose(x, y, rtol=1e-6, atol=1e-8 * np.abs(y).max(), err_msg=name)


def test_gradients_of_several_logs_at_once(params, samples):
    """Mapped over logs, where XLA once ended the process."""
    moved = with_part(params, "all")
    logs = jax.tree.map(lambda x: jnp.stack([x, x]), samples)

    def nats(bias, log):
        params = moved._replace(bias=bias)
        state = pipeline.init(params, log)
        return pipeline.run(params, state, log, Options(), lambda state, info: info.log_likelihood)[1].sum()

    one = jax.jit(jax.grad(nats))(moved.bias, samples)
    two = jax.jit(jax.grad(lambda bias: jax.vmap(nats, (None, 0))(bias, logs).sum()))(moved.bias)
    for x, y in zip(jax.tree.leaves(two), jax.tree.leaves(one), strict=True):
        np.testing.assert_allclose(x, 2 * y, rtol=1e-9, atol=1e-9 * np.abs(y).max())
