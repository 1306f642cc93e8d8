"""The passes of the method one by one, for experiments that filter a log with another noise than its own."""

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
from ftbias_jax.filtering.noise.log_noise import told
from ftbias_jax.filtering.samples import samples_of


@partial(jax.jit, static_argnames=("options", "layout"))
def blocks_of(params, samples, options, layout):
    """The log in blocks, with its joints smoothed."""
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
    """A log whose noise is found, and that is filtered, with these parameters; ``options`` state the gate."""

    def __init__(self, params, log):
        self.params, self.log, self.samples = params, log, samples_of(params, log)
        self.layout = layout_of(np.diff(log.t))

    def blocks(self, options):
        """Means and scatter of its blocks."""
        return blocks_of(self.params, self.samples, options, self.layout)

    def noise(self, blocks):
        """The noise of the filter, and what the blocks show: for ``filtered`` and ``in_words``."""
        return find(self.params.bias, blocks, self.layout)

    def in_words(self, noise):
        """The same one thing after the other."""
        return told(jax.tree.map(np.asarray, noise[1]), self.layout, slow_is_stated=False)

    def filtered(self, noise, options):
        """The result with this noise, None = as stated, and its parameters."""
        found = jax.tree.map(np.asarray, _filter(self.params, self.samples, noise, options, self.layout))
        contacts = () if noise is None else self.in_words(noise).contacts
        return result_of(self.log, *found[1:], contacts), found[0]
