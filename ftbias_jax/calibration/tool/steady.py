"""The bias that later logs should expect, from one log: constant, unless a drift is evident and predicts better.

A drift that one log shows would carry the bias away long before the next is recorded, and within seconds a model error
looks like one. So a drift must be likelier and must also predict the log's own readings better.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ftbias_jax.calibration.judgement import HORIZONS, SHORT, prediction_errors
from ftbias_jax.filtering.method.ready import filtered_with
from ftbias_jax.filtering.quality.observability import error_of_tool
from ftbias_jax.filtering.result import Filtered
from ftbias_jax.io.log import Log
from ftbias_jax.model.params import Params
from ftbias_jax.setup.types import Setup, ToolSetup
from ftbias_jax.types import Array

STEADY, CLEARLY = 1e-3, 6.0
"""Factor of the stated sigma_Q for a bias that does not drift, and nats by which one that drifts must be likelier."""


class SteadyBias(NamedTuple):
    """Prior of the bias in later logs; (6,)."""

    value: Array
    """N, Nm, bias."""
    std: Array
    """N, Nm, its standard deviation."""
    drift_std: Array
    """N/s, Nm/s, standard deviation of the drift with which later logs begin."""
    load_std: Array
    """N, Nm: standard deviation of the tool's wrench over the poses and motions of the log."""

    def std_with_tool(self, tool: ToolSetup) -> Array:
        """(6,) N, Nm: standard deviation of the bias, including that of a tool that states its standard errors.

        The bias was found with the tool as it is written, so at the poses of this log their errors cancel. At other
        poses they do not: those of the next log may differ from these as much as these from each other.
        """
        return np.hypot(self.std, error_of_tool(self.load_std[None], tool)[0])


def steady_bias(setup: Setup, log: Log) -> SteadyBias:
    """The bias of a log, filtered with the noise and the slow errors that the log shows.

    It is the bias at the end of the log with the stated drift, if a drift is clearly likelier than none and predicts
    the readings better; a log shorter than SHORT hardly shows how a bias moves. Otherwise it is a constant bias, and
    later logs begin with the drift that sigma_Q alone builds up from zero over this log.
    """
    given = replace(setup.bias, adapt=True)
    still = replace(given, noise_density=STEADY * given.noise_density, initial_drift_std=np.zeros(6))
    span = log.t[-1] - log.t[0]
    constant, of_constant = filtered_with(replace(setup, bias=still), log)
    load_std = np.asarray(constant.wrench_tool, float).std(0)
    if span >= SHORT:
        drifting, of_drifting = filtered_with(replace(setup, bias=given), log)
        likelier = drifting.log_likelihood > constant.log_likelihood + CLEARLY
        if likelier and predicts_better((drifting, of_drifting), (constant, of_constant)):
            return SteadyBias(drifting.bias[-1], drifting.bias_std[-1], given.initial_drift_std, load_std)
    wandered = np.minimum(given.initial_drift_std, given.noise_density * np.sqrt(span))
    return SteadyBias(constant.bias[-1], constant.bias_std[-1], wandered, load_std)


def predicts_better(one: tuple[Filtered, Params], other: tuple[Filtered, Params]) -> bool:
    """Whether a filter predicts the readings HORIZONS ahead better than another, averaged over axes and horizons."""
    ratios = []
    for ahead in HORIZONS:
        errors = np.stack([prediction_errors(result, params.bias, ahead) for result, params in (one, other)])
        errors = np.where(np.isfinite(errors).all(0), errors, 0)
        squares = (errors**2).sum(1)
        ratios.append(np.log(squares[0, squares[1] > 0] / squares[1, squares[1] > 0]))
    return bool(np.concatenate(ratios).sum() < 0)
