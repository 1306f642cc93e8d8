"""Logs filtered with parameters at hand, for the tests of what needs no setup."""

import jax
import numpy as np

from ftbias_jax.filtering.method.blocks import layout_of
from ftbias_jax.filtering.method.filter_samples import AS_STATED, filter_samples
from ftbias_jax.filtering.method.ready import result_of, samples_of
from ftbias_jax.filtering.params_for_log import without_useless
from ftbias_jax.filtering.pipeline import DEFAULT_OPTIONS


def found_in(params, log, options=DEFAULT_OPTIONS, method=AS_STATED):
    """Parameters, states and infos of a log, which go on with padding; NumPy arrays."""
    samples = samples_of(params, without_useless(log, params))
    found = filter_samples(params, samples, options, method=method, layout=layout_of(np.diff(log.t)))
    return jax.tree.map(np.asarray, found)


def filter_with_params(params, log, options=DEFAULT_OPTIONS):
    """The result of a log as a filter on the robot would see it."""
    _, states, infos = found_in(params, log, options)
    return result_of(without_useless(log, params), states, infos, None)
