import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.types import Model, Signals
from ftbias_jax.model.params import Params
from ftbias_jax.model.trajectories import excitation_sines
from ftbias_jax.types import Array

COUNT = 800


@pytest.fixture(scope="session")
def model(params: Params) -> Model:
    """The small arm, which is quick to compile, with its tool."""
    return Model(params.arm, params.gravity, params.theta)


@pytest.fixture(scope="session")
def signals(model: Model) -> Signals:
    """Ten seconds of brisk motion at irregular stamps, with a temperature that rises and falls."""
    dt = np.random.default_rng(1).uniform(0.5, 1.5, COUNT - 1)
    t = jnp.asarray(np.r_[0, np.cumsum(dt)] * 10 / dt.sum())
    motion = excitation_sines(jax.random.key(2), t, jnp.zeros(3), jnp.array([2.0, 0.3, 2.5]), base_frequency=0.15)
    return Signals(*motion, 25 + 3 * jnp.sin(0.9 * t), model)


@pytest.fixture(scope="session")
def wrench(signals: Signals) -> Array:
    """The reading if the setup were right."""
    return jax.jit(compose.predict)(signals, {})
