"""What the report shows of a diagnosis: where the gap is, and series for the plots."""

from __future__ import annotations

import jax
import numpy as np

from ftbias_jax.diagnosis.evidence.cross_validation import HeldOut, excess
from ftbias_jax.diagnosis.evidence.locate import Conditions, locate
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.evaluate import measured, readings
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.report.plotted import Series
from ftbias_jax.diagnosis.result import Where
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
    now = readings(problem, np.stack([base.z, accepted.z]))
    change = now[1] - now[0]
    for h, coefficients in zip(accepted.hypotheses, _by_hypothesis(accepted), strict=True):
        change = change + sum(
            (shape[:, None] * c for shape, c in zip(h.shapes, coefficients, strict=True)), np.zeros(6)
        )
    # A constant change is no regressor: the channel that changes most.
    channel = int((change / problem.noise_std).var(0).argmax())
    first, noise = _residual(problem, before)
    last, _ = _residual(problem, after)
    # Innovations are nearly white: what is left with the causes, plus what they add, is what was left without them.
    refitted = last + change - change.mean(0)
    found = []
    for log in range(len(problem.parts)):
        own = problem.log == log
        block = np.unique((problem.t[own] // SERIES_SECONDS).astype(int), return_inverse=True)[1]
        count = np.bincount(block)[:, None]

        def mean(x: np.ndarray, own: np.ndarray = own, block: np.ndarray = block) -> np.ndarray:
            sums = [np.bincount(block, column) for column in np.nan_to_num(x[own]).T]
            return np.stack(sums, -1) / np.bincount(block)[:, None]

        found.append(
            Series(
                t=mean(problem.t[:, None])[:, 0],
                before=mean(first),
                after=mean(last),
                noise=np.sqrt(mean(noise**2) / count),
                regressor=mean(change[:, channel : channel + 1])[:, 0],
                refitted=mean(refitted),
                regressor_name=f"predicted change of {AXES[channel]} [{AXIS_UNITS[channel]}]",
            )
        )
    return tuple(found)


def _by_hypothesis(found: Fit) -> list[np.ndarray]:
    """(E, 6) coefficients of each hypothesis."""
    pieces = np.split(found.coefficients, np.cumsum([6 * len(h.shapes) for h in found.hypotheses]))
    return [piece.reshape(-1, 6) for piece in pieces[: len(found.hypotheses)]]


def _residual(problem: Problem, held: HeldOut) -> tuple[np.ndarray, np.ndarray]:
    """Innovations (U, 6) N, Nm, NaN where there was no measurement, and their noise (U, 6)."""
    noise = np.sqrt(problem.variance)
    return np.where(problem.samples > 0, held.error * noise, np.nan), noise


def _motion(problem: Problem) -> Conditions:
    """What the robot was doing at the bins."""

    def join(name: str) -> np.ndarray:
        arrays = [np.asarray(getattr(part.signals, name))[: part.used] for part in problem.parts]
        return np.concatenate(arrays)

    motions = [part.nominal for part in problem.parts]
    speed, acceleration = join("dq"), join("ddq")
    carrier: Arm | FreeBody = problem.parts[0].signals.model.arm
    if isinstance(carrier, FreeBody):
        turning = [(m.angular_velocity.T, m.angular_acceleration.T) for m in motions]
        used = [[np.asarray(x)[: part.used] for x in pair] for part, pair in zip(problem.parts, turning, strict=True)]
        speed, acceleration = (np.concatenate(series) for series in zip(*used, strict=True))
    down = []
    for part, motion in zip(problem.parts, motions, strict=True):
        gravity = np.asarray(part.signals.model.gravity)
        R = np.asarray(motion.sensor_rotation)[:, :, : part.used]
        down.append(np.einsum("i,ijt->tj", gravity / np.linalg.norm(gravity), R))
    load = np.linalg.norm(np.nan_to_num(measured(problem)[:, :3]), axis=1)
    return Conditions(
        speed=np.linalg.norm(speed, axis=1),
        acceleration=np.linalg.norm(acceleration, axis=1),
        gravity=np.concatenate(down),
        load_rate=np.gradient(load) if len(load) > 1 else np.zeros(len(load)),
        temperature=problem.temperature if np.ptp(problem.temperature) > 0 else None,
    )
