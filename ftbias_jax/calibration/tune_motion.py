"""Noise that grows with the motion, of maximum likelihood: weights of the joints' speeds, and the speed they bend at.

The scatter within short blocks shows which joints and axes matter, and about how much (``noise.vibration``). From
there the likelihood of the wrench given the joints is climbed by its gradient.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.calibration import newton
from ftbias_jax.calibration.batching import stack
from ftbias_jax.calibration.data_noise import gradient
from ftbias_jax.calibration.data_noise.values import constrain
from ftbias_jax.calibration.newton import Report
from ftbias_jax.calibration.tune import TIES, Fit
from ftbias_jax.calibration.tune_blocks import LogInBlocks
from ftbias_jax.filtering import bias_filter, pipeline
from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.fast.scan import filter_sums, innovations
from ftbias_jax.filtering.likelihood import counted
from ftbias_jax.filtering.noise.vibration import Vibration
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.filtering.process_models import bias_model
from ftbias_jax.filtering.smoother import smooth_joints
from ftbias_jax.model.params import Params
from ftbias_jax.model.shown import not_shown
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import AXES, Array, Sample

NAME = "vibration"
BURN_IN = 1.0
"""s at the start of every log that do not count."""
MOST_SAMPLES = 1 << 16
"""Of all logs together, each from its beginning on: they tell a variance to a percent, and more would take minutes."""
WILD = 6.0
"""Standard deviations of a sample that is no noise of the motion, at what the blocks show: it does not count."""


class MovingLog(NamedTuple):
    """A log with its joints smoothed."""

    samples: Sample
    wrench_tool: Array
    """(T, 6) N, Nm."""
    joint_variance: Array
    """(T, 6) N^2, Nm^2: the joints' share of R."""
    velocity: Array
    """(T, n) rad/s."""


@dataclass(frozen=True)
class MotionScore:
    """Log-likelihood of the wrench given the joints; a gradient.Score whose parts are (params, one log)."""

    index: tuple[tuple[str, tuple[int, ...]], ...]
    """For each fitted name of values.WRENCH_NAMES which free value each axis has."""
    weights: tuple[int, ...]
    """Entries of the (n, 6) weights, row by row, that are fitted; their free values come next. The others are zero."""
    bends: bool
    """The last free value is the speed from which the variance grows with the speed alone."""

    def __call__(self, logs: Array, part: tuple[Params, MovingLog]) -> Array:
        """(P,) logarithms -> () nats."""
        params, log = part
        params = self.with_noise(params, logs)
        growing = bias_filter.vibration(params.bias, log.velocity)
        variance = log.joint_variance + params.bias.wrench_variance[None] + growing
        start = pipeline.init(params, log.samples)
        inputs = stages.bias_inputs(params, start, log.samples, log.wrench_tool, variance, log.velocity)
        weight = counted(log.samples.dt, BURN_IN)
        nats: Array = filter_sums(bias_model(inputs.density), False, inputs, weight).nats.sum()
        return nats

    def with_noise(self, params: Params, logs: Array) -> Params:
        """Parameters with the free values."""
        values = jnp.exp(logs)
        params = constrain(params, {name: logs[jnp.array(lanes)] for name, lanes in self.index})
        n, first = params.joint.process_density.shape[0], len(logs) - len(self.weights) - self.bends
        of_weights = values[first : first + len(self.weights)]
        rows = jnp.zeros(n * 6, logs.dtype).at[jnp.array(self.weights)].set(of_weights).reshape(n, 6)
        speed = values[-1] if self.bends else None
        return params._replace(bias=params.bias._replace(vibration=rows, vibration_speed=speed))


def shown_vibration(setup: Setup, logs: Sequence[LogInBlocks]) -> Vibration | None:
    """Of the log that shows it best; None = no log does, or the setup cannot state it, because it has no joints."""
    if NAME in not_shown(setup):
        return None
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
    """Fit the noise that grows with the motion, and sigma_Q and the sensor's noise beside it if they are asked for.

    Args:
        params: what is not fitted, and where to start with the rest; its joints' noise should be the likeliest.
        logs: samples of one robot.
        shown: by the blocks of the logs: where to start, which weights are not zero, and whether the growth bends.
        ties: key of TIES for each of values.WRENCH_NAMES that is to be fitted, too.
        options: of the pipeline.
        report: called with (iteration, nats).

    Returns:
        params with the noise, and the fit: ``vibration`` (n, 6) and, if it bends, ``vibration_speed`` (1,).
    """
    start_noise = params.bias._replace(
        vibration=jnp.asarray(shown.per_speed, params.theta.dtype),
        vibration_speed=None if shown.speed is None else jnp.asarray(shown.speed, params.theta.dtype),
    )
    started = params._replace(bias=start_noise)
    most = max(MOST_SAMPLES // len(logs), 1)
    shortened = [jax.tree.map(lambda x: np.asarray(x)[:most], log) for log in logs]
    longest = max(len(log.dt) for log in shortened)
    alike = [jax.tree.map(lambda x: x[0], stack([log], longest)) for log in shortened]
    moving = newton.for_each(partial(_moving, started, options=options), alike)
    return fit_motion(params, moving, shown, ties, report)


def fit_motion(
    params: Params, logs: Sequence[MovingLog], shown: Vibration, ties: dict[str, str], report: Report = newton.quiet
) -> tuple[Params, Fit]:
    """``tune_motion`` for joints that are already smoothed, or known; logs have arrays of the same shapes."""
    index, logs_of_start = _starts(params, ties)
    flat = np.asarray(shown.per_speed, float).ravel()
    weights = tuple(int(i) for i in np.flatnonzero(flat > 0))
    bend = [] if shown.speed is None else [float(np.log(shown.speed))]
    score = MotionScore(index, weights, bool(bend))
    first = np.array([*logs_of_start, *np.log(flat[list(weights)]), *bend])
    optimum = gradient.maximise(score, [(params, log) for log in logs], first[None], report)
    return score.with_noise(params, jnp.asarray(optimum.logs, params.theta.dtype)), _fit(score, optimum, len(flat))


def _fit(score: MotionScore, optimum: newton.Optimum, size: int) -> Fit:
    """Numbers and their relative standard errors by name; a weight that is zero is taken as known."""
    first = len(optimum.logs) - len(score.weights) - score.bends
    values = {name: np.exp(optimum.logs[list(lanes)]) for name, lanes in score.index}
    errors = {name: optimum.stderr[list(lanes)] for name, lanes in score.index}
    of_weights = slice(first, first + len(score.weights))
    rows, row_errors = np.zeros((2, size))
    fitted = list(score.weights)
    rows[fitted], row_errors[fitted] = np.exp(optimum.logs[of_weights]), optimum.stderr[of_weights]
    values[NAME], errors[NAME] = rows.reshape(-1, 6), row_errors.reshape(-1, 6)
    if score.bends:
        values[f"{NAME}_speed"], errors[f"{NAME}_speed"] = np.exp(optimum.logs[-1:]), optimum.stderr[-1:]
    names = [f"joint {i // 6 + 1} {AXES[i % 6]}" for i in score.weights]
    faint = [name for name, error in zip(names, optimum.stderr[of_weights], strict=True) if not error < 1]
    return Fit(values, errors, [f"{NAME} of {', '.join(faint)}"] if faint else [], optimum)


def _starts(params: Params, ties: dict[str, str]) -> tuple[tuple[tuple[str, tuple[int, ...]], ...], list[float]]:
    """Which free value each axis of each name has, and the logarithms to start from."""
    stated = {"density": params.bias.density, "wrench_std": jnp.sqrt(params.bias.wrench_variance)}
    index, logs = [], list[float]()
    for name, tie in ties.items():
        group, value = TIES[tie](6), np.log(np.asarray(stated[name], float))
        index.append((name, tuple(int(lane) + len(logs) for lane in group)))
        logs += [float(value[group == g].mean()) for g in range(group.max() + 1)]
    return tuple(index), logs


@partial(jax.jit, static_argnames="options")
def _moving(params: Params, samples: Sample, options: Options) -> MovingLog:
    """The log as the score needs it, without the readings that are WILD for these parameters."""
    start = pipeline.init(params, samples)
    joints = smooth_joints(params, start, samples, options)
    velocity = joints.mean[:, :, 1]
    wrench_tool, variance = stages.predict_wrenches(params, joints, samples, options)
    inputs = stages.bias_inputs(params, start, samples, wrench_tool, variance, velocity)
    innovation, spread = innovations(bias_model(inputs.density), inputs)
    wild = jnp.abs(innovation[:, 0]) > WILD * jnp.sqrt(spread[:, 0])
    kept = samples._replace(wrench=jnp.where(wild, jnp.nan, samples.wrench))
    of_noise = params.bias.wrench_variance[None] + bias_filter.vibration(params.bias, velocity)
    return MovingLog(kept, wrench_tool, variance - of_noise, velocity)
