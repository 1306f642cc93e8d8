"""Small filters with different values in every lane, for the tests of the fast scans."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.filtering.fast.scan import Inputs
from ftbias_jax.filtering.process_models import JOINT_MODELS, drift_noise

COUNT, LANES = 24, 3
GAP = 12  # the sample before which there are no data for ten seconds
MODELS = {**JOINT_MODELS, "drift": drift_noise}

models = pytest.mark.parametrize("model", MODELS)


def sizes(model):
    """States, and how many of them are measured."""
    return (2, 1) if model == "drift" else (3, 2)


def problem(model, seed, gap=10.0):
    """Filters that restart after the gap, except for the bias, which never does; two samples have one stamp."""
    rng = np.random.default_rng(seed)
    k, m = sizes(model)
    dt = rng.uniform(0.01, 0.1, COUNT)
    dt[[0, 4, GAP]] = 0, 0, gap
    y = 0.3 * rng.normal(size=(COUNT, m, LANES))
    y[rng.uniform(size=y.shape) < 0.3] = np.nan
    y[5] = np.nan
    variance = rng.uniform(0.01, 0.1, y.shape) ** 2
    root = rng.normal(size=(LANES, k, k))
    covariance = np.moveaxis(root @ np.swapaxes(root, 1, 2), 0, -1) + np.eye(k)[:, :, None]
    restart = np.full((k, LANES), np.inf) if model == "drift" else rng.uniform(4, 9, (k, LANES))
    values = (dt, rng.uniform(1, 5, LANES), y, variance, rng.normal(size=(k, LANES)), covariance, restart)
    return Inputs(*map(jnp.asarray, values))


def single(tree):
    """The same numbers in float32."""
    return jax.tree.map(lambda x: x.astype(jnp.float32), tree)


def assert_all_close(got, expected, rtol, atol=None):
    """Trees agree, by default to a tenth of ``rtol`` of each leaf's largest entry; NaN in the same places."""
    for (path, one), other in zip(jax.tree.leaves_with_path(expected), jax.tree.leaves(got), strict=True):
        least = (rtol / 10 if atol is None else atol) * np.nanmax(np.abs(one), initial=0.0)
        np.testing.assert_allclose(other, one, rtol=rtol, atol=least, err_msg=jax.tree_util.keystr(path))


_ALL = {
    "vibration": jnp.asarray(0.3 * np.linspace(0.5, 2, 3)[:, None] * np.ones(6)),
    "vibration_speed": jnp.asarray(0.5),
    "drift_time": jnp.linspace(0.3, 5, 6),
    "correlated_std": jnp.linspace(0.02, 0.2, 6),
    "correlated_time": jnp.linspace(0.02, 1, 6),
    "correlated_vibration": jnp.linspace(0, 1, 6),
}
_NAMES = {
    "as stated": (),
    "vibration": ("vibration",),
    "a drift that reverts": ("drift_time",),
    "correlated noise": ("correlated_std", "correlated_time"),
    "noise that follows the motion, and is correlated": tuple(_ALL),
}
PARTS = {part: {name: _ALL[name] for name in names} for part, names in _NAMES.items()}
"""Optional parts of the bias filter's noise, for three joints."""
ALL = "noise that follows the motion, and is correlated"
parts = pytest.mark.parametrize("part", PARTS)


def with_part(params, part):
    return params._replace(bias=params.bias._replace(**PARTS[part]))
