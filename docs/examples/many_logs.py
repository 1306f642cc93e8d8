"""Filter logs of equal length with one program, and differentiate the bias uncertainty with respect to sigma_Q."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import ftbias_jax as ft

jax.config.update("jax_enable_x64", True)

setup = ft.load_setup(Path(__file__).with_name("setup.toml"))
logs = [ft.simulate(setup, duration=10.0, rate=250.0, seed=seed).log for seed in range(4)]
params = ft.params_for_log(setup, logs[0], guarded=False)  # the joints are smoothed, so no guard against lag is needed
samples = [ft.samples_from_log(log)._replace(temperature=None) for log in logs]
many = jax.tree.map(lambda *x: jnp.stack(x), *samples)
layout = ft.layout_of(np.asarray(samples[0].dt))


def filtered(params, samples):
    """Return the parameters with the noise of the log, and the states and infos of every sample."""
    return ft.filter_samples(params, samples, layout=layout)


_, states, infos = jax.jit(jax.vmap(filtered, (None, 0)))(params, many)
print("bias of fz at the end:", states.bias[:, -1, 2], "N, standard deviation", states.bias_std[:, -1, 2])
print("log-likelihoods:", infos.log_likelihood)


def uncertainty(log_density):
    """Mean standard deviation of the bias, over N and Nm alike, if sigma_Q is multiplied by exp(log_density)."""
    bias = params.bias._replace(density=params.bias.density * jnp.exp(log_density))
    return filtered(params._replace(bias=bias), samples[0])[1].bias_std.mean()


print("an e-fold of sigma_Q changes it by", jax.grad(uncertainty)(0.0))
