"""The bias that logs which follow should expect, by one log: a constant one, unless a drift shows and predicts better.

A drift that one log shows would carry the bias away long before the next is recorded, and in seconds an error of the
model looks like one. So a drift must be likelier and must also predict the log's own readings better.
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
"""sigma_Q of a bias that does not drift, in the stated one, and nats by which one that drifts must be likelier."""


class SteadyBias(NamedTuple):
    """Prior of logs that follow; (6,)."""

    value: Array
    """N, Nm."""
    std: Array
    """N, Nm."""
    drift_std: Array
    """N/s, Nm/s, of the drift with which they begin."""
    load_std: Array
    """N, Nm: scatter of the tool's wrench over the poses and motions of the log."""

    def std_with_tool(self, tool: ToolSetup) -> Array:
        """(6,) N, Nm: standard deviation of the bias, with that of a tool that states its standard errors.

        The bias was found with the tool as it is written, so at the poses of this log their errors cancel. At others
        they do not: the next log's may be as far from these as these are from each other.
        """
        return np.hypot(self.std, error_of_tool(self.load_std[None], tool)[0])


def steady_bias(setup: Setup, log: Log) -> SteadyBias:
    """The bias of a log, with what the log shows of noise and of errors that vary slowly.

    That at the end of the log, and the stated drift, if a drift is clearly likelier than none and predicts the readings
    better; a log of less than SHORT hardly shows how a bias moves. Otherwise a constant one, and of the drift only what
    its noise makes of none in the time of a log.
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
    """Whether a filter predicts the readings HORIZONS ahead better than another, in the mean over axes and horizons."""
    ratios = []
    for ahead in HORIZONS:
        errors = np.stack([prediction_errors(result, params.bias, ahead) for result, params in (one, other)])
        errors = np.where(np.isfinite(errors).all(0), errors, 0)
        squares = (errors**2).sum(1)
        ratios.append(np.log(squares[0, squares[1] > 0] / squares[1, squares[1] > 0]))
    return bool(np.concatenate(ratios).sum() < 0)
