"""A setup that knows of an effect: filter, likelihood and smoother then include it."""

import by_params
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from demo_logs import T, recorder

from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.filtering import params_for_log, pipeline
from ftbias_jax.filtering.samples import samples_from_log
from ftbias_jax.model.effects.catalogue import CATALOGUE, typical_values
from ftbias_jax.model.effects.types import Model
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.setup import parse_setup

SMOOTH = [
    name
    for name, effect in CATALOGUE.items()
    if effect.hook != "record" and not any(parameter.search for parameter in effect.parameters)
]


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


def strong(name, params):
    """Five times the typical departure, so that the filter that does not know it fails clearly."""
    model = Model(params.arm, params.gravity, params.theta)
    effect = CATALOGUE[name]
    typical = typical_values(effect, model)
    neutral = {
        p.name: jnp.asarray(p.neutral(model) if callable(p.neutral) else p.neutral, float) for p in effect.parameters
    }
    return {name: {key: neutral[key] + 5 * (typical[key] - neutral[key]) for key in typical}}


def innovation_rms(params, log):
    """Root mean square of the second half's innovations, (6,) N, Nm."""
    innovation = by_params.filter_with_params(params, log).innovation
    return np.sqrt(np.mean(innovation[len(innovation) // 2 :] ** 2, 0))


@pytest.mark.slow
@pytest.mark.parametrize("name", SMOOTH)
def test_a_known_smooth_effect_leaves_the_noise_floor(name, params, record):
    effects = strong(name, params)
    floor = innovation_rms(params, record(None))  # of the same noise
    log = record(effects)
    unknown = innovation_rms(params, log) / floor
    known = innovation_rms(params._replace(effects=effects), log) / floor
    if name != "tool_inertia":  # slow motion hardly shows it
        assert unknown.max() > 1.1
    np.testing.assert_allclose(known, 1, atol=0.05)


def test_a_saturated_sample_is_not_used(params, record):
    log = record(None)
    limits = np.array([1e3, 1e3, np.nanquantile(np.abs(log.wrench[:, 2]), 0.97), 1e3, 1e3, 1e3])
    clipped = log._replace(wrench=np.clip(log.wrench, -limits, limits))
    effects = {"saturation": {"limits": jnp.array(limits)}}
    used = params_for_log.without_useless(clipped, params._replace(effects=effects)).wrench
    stuck = np.abs(log.wrench[:, 2]) >= limits[2]
    assert np.isnan(used[stuck, 2]).all()
    assert np.isfinite(used[~stuck]).all()


def test_a_setup_carries_effects_into_the_parameters():
    setup = parse_setup(SETUP | {"effects": {"gain": {"gain": 1.05}}}, "known.toml")
    np.testing.assert_allclose(params_from_setup(setup).effects["gain"]["gain"], np.full(6, 1.05))
    assert params_from_setup(parse_setup(SETUP, "plain.toml")).effects is None


def test_single_steps_refuse_effects(params, record):
    """An effect with a memory cannot be had from one sample."""
    samples = samples_from_log(record(None))
    knowing = params._replace(effects={"gain": {"gain": jnp.ones(6)}})
    first = jax.tree.map(lambda x: x[0], samples)
    with pytest.raises(ValueError, match="whole logs"):
        pipeline.step(knowing, pipeline.init(params, samples), first)
