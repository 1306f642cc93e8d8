"""Maximum-likelihood noise that grows with the motion: weights of joint speeds, and the speed where it turns linear.

The scatter within short blocks shows which joints and axes matter, and about how much (``noise.vibration``). From there
the likelihood of the wrench given the joints is maximised.
"""

from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.calibration import newton
from ftbias_jax.calibration.newton import Report, Search
from ftbias_jax.calibration.noise.score import WrenchLogs, own_variance, smoothed_wrenches
from ftbias_jax.calibration.noise.values import VIBRATION, VIBRATION_SPEED, tied
from ftbias_jax.calibration.tune import Fit, as_fit, fit_common, stack, stated_noise, with_values
from ftbias_jax.calibration.tune_blocks import LogInBlocks
from ftbias_jax.filtering import pipeline
from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.fast.scan import innovations
from ftbias_jax.filtering.noise.vibration import Vibration
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.filtering.process_models import bias_model
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.model.params import Params
from ftbias_jax.types import Sample

MOST_SAMPLES = 1 << 16
"""Samples of all logs together, each from its start: they give a variance to a percent, more would take minutes."""
LEAST_SPEED = next(each.lower for each in CATALOGUE[VIBRATION].parameters if each.name == "speed")
"""rad/s: smallest speed that a setup can state."""
OUTLIER_STD = 6.0
"""Standard deviations, with the noise that the blocks show, beyond which a reading is left out as an outlier."""


def shown_vibration(logs: Sequence[LogInBlocks]) -> Vibration | None:
    """Noise in motion from the log that shows it best; None = no log does."""
    found = [log.noise.vibration for log in logs if log.noise.vibration is not None]
    best = max(found, key=lambda vibration: vibration.gain, default=None)
    return best if best is not None and best.per_speed.any() else None


def tune_motion(
    params: Params,
    logs: Sequence[Sample],
    shown: Vibration,
    ties: dict[str, str],
    options: Options,
    report: Report = newton.quiet,
) -> tuple[Params, Fit]:
    """Fit the noise that grows with the motion, and sigma_Q and the sensor's noise with it if they are asked for.

    Args:
        params: values that are not fitted, and starting values of the rest; the joint noise should be the likeliest.
        logs: samples of one robot.
        shown: what the blocks show: starting values, which weights are not zero, and whether growth turns linear.
        ties: key of TIES for each of values.WRENCH_NAMES that is to be fitted, too.
        options: options of the pipeline.
        report: called with (iteration, nats).

    Returns:
        params with the noise, and the fit: ``vibration`` (n, 6) and, with linear growth, ``vibration_speed`` (1,).
    """
    dtype = params.theta.dtype
    speed = None if shown.speed is None else jnp.asarray(shown.speed, dtype)
    bias = params.bias._replace(vibration=jnp.asarray(shown.per_speed, dtype), vibration_speed=speed)
    started = params._replace(bias=bias)
    most = max(MOST_SAMPLES // len(logs), 1)
    shortened = [jax.tree.map(lambda x: np.asarray(x)[:most], log) for log in logs]
    longest = max(len(log.dt) for log in shortened)
    stacked = [stack([log], longest) for log in shortened]
    smoothed = newton.for_each(partial(smoothed_wrenches, started, options=options, moving=True), stacked)
    return fit_motion(params, newton.for_each(partial(_without_outliers, started), smoothed), shown, ties, report)


def fit_motion(
    params: Params, logs: Sequence[WrenchLogs], shown: Vibration, ties: dict[str, str], report: Report = newton.quiet
) -> tuple[Params, Fit]:
    """``tune_motion`` for joints that are already smoothed or known; a log has a leading axis of 1."""
    start = {name: stated_noise(params)[name] for name in ties} | {VIBRATION: shown.per_speed}
    if shown.speed is not None:
        start[VIBRATION_SPEED] = np.array([shown.speed])
    index, logarithms = tied(start, {VIBRATION: "each", VIBRATION_SPEED: "one", **ties})
    fit = as_fit(index, fit_common([(params, log) for log in logs], index, logarithms, Search(report=report)))
    if VIBRATION_SPEED in fit.values:  # below this limit of a setup, all growth is linear anyway
        fit.values[VIBRATION_SPEED] = np.maximum(fit.values[VIBRATION_SPEED], LEAST_SPEED)
    return with_values(params, fit), fit


@jax.jit
def _without_outliers(params: Params, logs: WrenchLogs) -> WrenchLogs:
    """The logs without readings whose innovations exceed WILD standard deviations for these parameters."""

    def kept(log: WrenchLogs) -> Sample:
        variance = log.joint_variance + own_variance(params, log.velocity)
        start = pipeline.init(params, log.samples)
        inputs = stages.bias_inputs(params, start, log.samples, log.wrench_tool, variance, log.velocity)
        innovation, spread = innovations(bias_model(inputs.density), inputs)
        outlier = jnp.abs(innovation[:, 0]) > OUTLIER_STD * jnp.sqrt(spread[:, 0])
        return log.samples._replace(wrench=jnp.where(outlier, jnp.nan, log.samples.wrench))

    return logs._replace(samples=jax.vmap(kept)(logs))
