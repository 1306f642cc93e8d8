"""What the report shows of a diagnosis: where the gap is, and series for the plots."""

from __future__ import annotations

import jax
import numpy as np

from ftbias_jax.diagnosis.evidence.gap import HeldOut, excess
from ftbias_jax.diagnosis.evidence.locate import Conditions, locate
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.evaluate import measured, over_bins, readings, sensor_axes
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.result import Series, Where
from ftbias_jax.diagnosis.samples.bins import sum_of_bins
from ftbias_jax.model.kinematics.recorded_pose import FreeBody
from ftbias_jax.model.kinematics.screws import Arm
from ftbias_jax.types import AXES, AXIS_UNITS

SERIES_SECONDS = 0.2
BREAK = 10.0
"""s between two logs laid end to end."""


def where(problem: Problem, held: HeldOut, stages: tuple[str, ...]) -> Where:
    """Location of the gap; with several logs, the times are those of the log with the largest gap."""
    residual, noise = _residual(problem, held)
    starts = np.concatenate([[0.0], np.cumsum(np.array(problem.durations) + BREAK)])
    whole = locate(residual, noise, problem.t + starts[problem.log], _motion(problem), stages)
    if len(problem.parts) == 1:
        return whole
    worst = int(np.argmax(np.bincount(problem.log, excess(problem, held.error).sum(1))))
    own = problem.log == worst
    motion = jax.tree.map(lambda x: x[own], _motion(problem))
    return whole._replace(intervals=locate(residual[own], noise[own], problem.t[own], motion, stages).intervals)


def show(problem: Problem, base: Fit, accepted: Fit, before: HeldOut, after: HeldOut) -> tuple[Series, ...]:
    """Coarse means of the innovations of each log, and what the causes change in the reading."""
    without, with_causes = readings(problem, np.stack([base.z, accepted.z]))
    change = with_causes - without
    shapes = [shape for h in accepted.hypotheses for shape in h.shapes]
    for shape, coefficients in zip(shapes, accepted.coefficients.reshape(-1, 6), strict=True):
        change = change + shape[:, None] * coefficients
    # A constant change is no regressor: the channel that changes most.
    channel = int((change / problem.noise_std).var(0).argmax())
    first, noise = _residual(problem, before)
    last, _ = _residual(problem, after)
    # Innovations are nearly white: what is left with the causes, plus what they add, is what was left without them.
    refitted = last + change - change.mean(0)
    arrays = (problem.t, first, last, noise**2, change[:, channel], refitted)
    found = []
    for log in range(len(problem.parts)):
        own = problem.log == log
        block = np.unique((problem.t[own] // SERIES_SECONDS).astype(int), return_inverse=True)[1]
        counts = np.bincount(block)
        means = [(sum_of_bins(block, np.nan_to_num(x[own])).T / counts).T for x in arrays]
        t, at_first, at_last, variance, regressor, whole = means
        noise_std, name = np.sqrt(variance / counts[:, None]), f"predicted change of {AXES[channel]}"
        found.append(Series(t, at_first, at_last, noise_std, regressor, f"{name} [{AXIS_UNITS[channel]}]", whole))
    return tuple(found)


def _residual(problem: Problem, held: HeldOut) -> tuple[np.ndarray, np.ndarray]:
    """Innovations (U, 6) N, Nm, NaN where there was no measurement, and their noise (U, 6)."""
    noise = np.sqrt(problem.variance)
    return np.where(problem.samples > 0, held.error * noise, np.nan), noise


def _motion(problem: Problem) -> Conditions:
    """What the robot was doing at the bins."""
    carrier: Arm | FreeBody = problem.parts[0].signals.model.arm
    gravity = np.asarray(problem.parts[0].signals.model.gravity)
    if isinstance(carrier, FreeBody):
        speed = over_bins(problem, lambda part: part.nominal.angular_velocity.T)
        acceleration = over_bins(problem, lambda part: part.nominal.angular_acceleration.T)
    else:
        speed = over_bins(problem, lambda part: part.signals.dq)
        acceleration = over_bins(problem, lambda part: part.signals.ddq)
    load = np.linalg.norm(np.nan_to_num(measured(problem)[:, :3]), axis=1)
    return Conditions(
        speed=np.linalg.norm(speed, axis=1),
        acceleration=np.linalg.norm(acceleration, axis=1),
        gravity=np.einsum("i,tij->tj", gravity / np.linalg.norm(gravity), sensor_axes(problem)),
        load_rate=np.gradient(load) if len(load) > 1 else np.zeros(len(load)),
        temperature=problem.temperature if np.ptp(problem.temperature) > 0 else None,
    )
