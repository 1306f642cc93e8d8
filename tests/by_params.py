"""Logs filtered with given parameters, for tests that need no setup."""

import jax
import numpy as np

from ftbias_jax.filtering.method.filter_samples import AS_STATED, filter_samples
from ftbias_jax.filtering.method.ready import result_of
from ftbias_jax.filtering.noise.blocks import Layout, layout_of
from ftbias_jax.filtering.params_for_log import without_useless
from ftbias_jax.filtering.pipeline import DEFAULT_OPTIONS
from ftbias_jax.filtering.result import ARRAYS, Filtered
from ftbias_jax.filtering.samples import samples_of


def found_in(params, log, options=DEFAULT_OPTIONS, method=AS_STATED):
    """Parameters, states and infos of a log without its padding; NumPy arrays."""
    samples = samples_of(params, without_useless(log, params))
    found = filter_samples(params, samples, options, method=method, layout=layout_of(np.diff(log.t)))
    return jax.tree.map(np.asarray, found)


def filter_with_params(params, log, options=DEFAULT_OPTIONS):
    """The result of a log as a filter on the robot would see it."""
    _, states, infos = found_in(params, log, options)
    return result_of(without_useless(log, params), states, infos, None)


def part_of(filtered, rows):
    """The result at some of its samples (rows)."""
    named = {name: getattr(filtered, name) for name in ARRAYS}
    return Filtered(**{name: x[rows] if np.ndim(x) else x for name, x in named.items()})


def smooth_bias(params, samples, options=DEFAULT_OPTIONS):
    """Bias and drift given the whole log, on smoothed joints: means and standard deviations (T, 2, 6)."""
    method = ("smooth_joints", "filter_bias", "smooth_bias")
    layout = Layout(25, 0.05)  # of blocks, which are not used here
    states = filter_samples(params, samples, options, method=method, layout=layout)[1]
    return states.bias_smooth, states.bias_smooth_std
