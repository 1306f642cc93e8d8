"""The passes of ``filter_log`` one by one, for experiments that filter a log with noise that was fitted elsewhere."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.filtering import pipeline
from ftbias_jax.filtering.likelihood import measured_length
from ftbias_jax.filtering.method import passes
from ftbias_jax.filtering.method.joints import smooth_joints
from ftbias_jax.filtering.method.ready import result_of
from ftbias_jax.filtering.method.work import Work
from ftbias_jax.filtering.noise.blocks import jumps_in, layout_of, to_samples, without_jumps
from ftbias_jax.filtering.noise.fit_noise import fit_noise
from ftbias_jax.filtering.noise.log_noise import log_noise_from
from ftbias_jax.filtering.samples import samples_of


@partial(jax.jit, static_argnames=("options", "layout"))
def blocks_of(params, samples, options, layout):
    """Block means and scatter of a log, after its joints are smoothed."""
    blocks = passes.blocks_of(smooth_joints(_work(params, samples, options, layout)))
    return blocks if samples.rezeroed is None else without_jumps(blocks, jumps_in(layout, samples.rezeroed))


find = jax.jit(fit_noise, static_argnums=2)


@partial(jax.jit, static_argnames=("options", "layout"))
def _filter(params, samples, noise, options, layout):
    work = smooth_joints(_work(params, samples, options, layout))
    if noise is not None:
        touched = to_samples(layout, noise[1].contacts.near, len(work.t))
        work = passes.with_noise(work, *noise)._replace(touched=touched)
    return passes.summarise(passes.filter_bias(work))


def _work(params, samples, options, layout):
    start = pipeline.init(params, samples)._replace(bias=None)
    return Work(params, start, samples, jnp.cumsum(samples.dt), measured_length(samples), layout, options)


class Log:
    """A log with parameters, to fit its noise and to filter it; ``options`` set the gate."""

    def __init__(self, params, log):
        self.params, self.log, self.samples = params, log, samples_of(params, log)
        self.layout = layout_of(np.diff(log.t))

    def blocks(self, options):
        """Return means and scatter of the blocks of the log."""
        return blocks_of(self.params, self.samples, options, self.layout)

    def noise(self, blocks):
        """Fit the noise to blocks; return the filter's noise and the findings, for ``filtered`` and ``in_words``."""
        return find(self.params.bias, blocks, self.layout)

    def in_words(self, noise):
        """Return the findings of ``noise`` as the noise report of a result."""
        return log_noise_from(jax.tree.map(np.asarray, noise[1]), self.layout, slow_is_stated=False)

    def filtered(self, noise, options):
        """Filter the log with this noise (None = as stated in the setup); return the result and its parameters."""
        found = jax.tree.map(np.asarray, _filter(self.params, self.samples, noise, options, self.layout))
        contacts = () if noise is None else self.in_words(noise).contacts
        return result_of(self.log, *found[1:], contacts), found[0]
