"""Small filters with values of their own in every lane, for the tests of the fast scans."""

import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.filtering.fast.scan import Inputs
from ftbias_jax.filtering.process_models import JOINT_MODELS, drift_noise

COUNT, LANES = 24, 3
GAP = 12  # the sample before which nothing comes for ten seconds
MODELS = {**JOINT_MODELS, "drift": drift_noise}

models = pytest.mark.parametrize("model", MODELS)


def sizes(model):
    """States, and how many of them are measured."""
    return (2, 1) if model == "drift" else (3, 2)


def problem(model, seed, gap=True):
    """Filters with values of their own in every lane; restarts after the gap, but for the bias, which never does."""
    rng = np.random.default_rng(seed)
    k, m = sizes(model)
    dt = rng.uniform(0.01, 0.1, COUNT)
    dt[0] = 0
    dt[GAP] = 10 if gap else 0.1
    y = 0.3 * rng.normal(size=(COUNT, m, LANES))
    y[rng.uniform(size=y.shape) < 0.3] = np.nan
    y[5] = np.nan
    variance = rng.uniform(0.01, 0.1, y.shape) ** 2
    root = rng.normal(size=(LANES, k, k))
    covariance = np.moveaxis(root @ np.swapaxes(root, 1, 2), 0, -1) + np.eye(k)[:, :, None]
    restart = np.full((k, LANES), np.inf) if model == "drift" else rng.uniform(4, 9, (k, LANES))
    values = (dt, rng.uniform(1, 5, LANES), y, variance, rng.normal(size=(k, LANES)), covariance, restart)
    return Inputs(*map(jnp.asarray, values))
