"""A setup that knows of an effect: filter, likelihood and smoother then include it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from demo_logs import T, recorder

from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.filtering import params_for_log, pipeline
from ftbias_jax.filtering.samples import samples_from_log
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.setup import parse_setup


@pytest.fixture(scope="module")
def setup():
    """Encoders so good that what is left is the sensor's noise, whatever the effect does to the joints' share."""
    joints = {"position_noise_std": 1e-6, "velocity_noise_std": 1e-5, "process_noise_density": 0.3}
    return parse_setup(SETUP | {"joints": joints}, "known.toml")


@pytest.fixture(scope="module")
def params(setup):
    return params_from_setup(setup)


@pytest.fixture(scope="module")
def record(params):
    """(effects or None) -> the log of one motion with these effects; the noise is the same in all."""
    return recorder(params, 1, temperature=25 + 4 * np.sin(T / 3))


def test_a_saturated_sample_is_not_used(params, record):
    log = record(None)
    limits = np.array([1e3, 1e3, np.nanquantile(np.abs(log.wrench[:, 2]), 0.97), 1e3, 1e3, 1e3])
    clipped = log._replace(wrench=np.clip(log.wrench, -limits, limits))
    effects = {"saturation": {"limits": jnp.array(limits)}}
    used = params_for_log.without_useless(clipped, params._replace(effects=effects)).wrench
    stuck = np.abs(log.wrench[:, 2]) >= limits[2]
    assert np.isnan(used[stuck, 2]).all()
    assert np.isfinite(used[~stuck]).all()


def test_single_steps_refuse_effects(params, record):
    """An effect with a memory cannot be had from one sample."""
    samples = samples_from_log(record(None))
    knowing = params._replace(effects={"gain": {"gain": jnp.ones(6)}})
    first = jax.tree.map(lambda x: x[0], samples)
    with pytest.raises(ValueError, match="whole logs"):
        pipeline.step(knowing, pipeline.init(params, samples), first)
