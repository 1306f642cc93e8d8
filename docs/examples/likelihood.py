"""Compute the log-likelihoods of several logs in one batch, and their gradients with respect to every parameter."""

from pathlib import Path

import jax
import jax.numpy as jnp

import ftbias_jax as ft
from ftbias_jax.filtering.samples import pad

jax.config.update("jax_enable_x64", True)

setup = ft.load_setup(Path(__file__).with_name("setup.toml"))
logs = [ft.simulate(setup, duration=seconds, rate=200, seed=seed).log for seed, seconds in enumerate((4, 4, 3))]
samples = [ft.samples_from_log(log) for log in logs]
params = ft.params_for_log(setup, logs[0])

# Padding makes the logs equally long without changing a result, so one compiled program maps over all of them.
longest = max(len(log.t) for log in logs)
together = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(pad(one, longest) for one in samples))
value_and_grad = jax.jit(jax.vmap(jax.value_and_grad(ft.log_likelihood), (None, 0)))
values, gradients = value_and_grad(params, together)

print("log-likelihood of each log [nats]:", values)
print("its derivatives with respect to m [1/kg] and m c [1/(kg m)]:", gradients.theta[:, :4], sep="\n")
assert jnp.allclose(values[2], ft.log_likelihood(params, samples[2]))  # the shortest one, without padding
