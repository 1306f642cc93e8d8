"""Noise as unconstrained numbers: logarithms by name, and back."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.calibration.noise.values import constrain, unconstrain
from ftbias_jax.errors import UsageError


def test_free_numbers_lead_back_to_the_same_parameters(params):
    there_and_back = constrain(params, unconstrain(params))
    for one, two in zip(jax.tree.leaves(params), jax.tree.leaves(there_and_back), strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-6)


def test_all_free_numbers_give_noise_that_is_positive(params):
    free = {name: jnp.linspace(-20.0, 20.0, x.size).reshape(x.shape) for name, x in unconstrain(params).items()}
    noise = constrain(params, free)
    np.testing.assert_allclose(noise.bias.wrench_variance, np.exp(2 * free["wrench_std"]), rtol=1e-6)
    np.testing.assert_allclose(noise.joint.position_std, np.exp(free["position_std"]), rtol=1e-6)
    assert all((x > 0).all() for x in (*noise.joint[:3], noise.bias.density, noise.bias.data_variance))


def test_what_is_zero_stays_zero_and_has_no_slope(params):
    variance = jnp.asarray(params.bias.data_variance).at[3].set(0.0)
    free = unconstrain(params._replace(bias=params.bias._replace(data_variance=variance)))["entries"]
    slope = jax.grad(lambda x: constrain(params, {"entries": x}).bias.data_variance.sum())(free)
    assert slope[3] == 0
    assert np.isfinite(slope).all()
    assert constrain(params, {"entries": free + 1.0}).bias.data_variance[3] == 0


def test_names_that_do_not_exist_are_refused(params):
    with pytest.raises(UsageError, match="no noise 'sigma_q'"):
        constrain(params, {"sigma_q": jnp.zeros(6)})
    with pytest.raises(UsageError, match="angular_acceleration, angular_velocity, gravity_direction"):
        constrain(params, {"linear_acceleration": jnp.zeros(3)})


def test_parameters_without_noise_of_the_motion_have_no_entries(params):
    assert "entries" not in unconstrain(params._replace(bias=params.bias._replace(data_variance=None)))
