"""The tool's mass and centre of mass from static poses, the standard calibration of a force-torque sensor."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.calibration.identify import GRAVITY_STD, KEPT, MOUNTING_STD, PULLED, Identified
from ftbias_jax.calibration.tool.mounting import likely_rotation
from ftbias_jax.calibration.tool.physical import FIXED, NAMES, theta_of, tool_units
from ftbias_jax.calibration.tool.shown import condition, undetermined
from ftbias_jax.calibration.tool.static import Estimate, Problem, estimate, weight_columns
from ftbias_jax.filtering.noise.fit_noise import MAD
from ftbias_jax.io.tables.poses import Poses
from ftbias_jax.model.kinematics.recorded_pose import motion_of
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.setup.require import orientation_alone
from ftbias_jax.setup.rotations import skew, vector_from_rotation
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

TOUCHED, FEWEST, MOST_TOUCHED = 8.0, 12, 0.2
"""Robust standard deviations by which a touched pose is off what the others predict; poses that must remain; and the
share that may be left out."""
CENTER_STD = 0.3
"""m, prior standard deviation of the centre of mass about the stated one; wide for any tool."""


class PoseReport(NamedTuple):
    """How well the poses are predicted."""

    poses: int
    drift: np.ndarray
    """(2,) N, Nm: typical step of the bias of forces and torques from one pose to the next; 0 = constant bias."""
    enlarged: float
    """Factor that enlarges all standard errors because the force axes disagree on the mass; 1 = they agree."""
    left_out: np.ndarray
    """(2,) N, Nm: rms error per axis, of forces and of torques, of a pose predicted from all others."""
    plain: np.ndarray
    """(4,) mass in kg and centre of mass in m by plain least squares with a constant bias."""
    plain_left_out: np.ndarray
    """(2,) N, Nm: the same errors with plain least squares."""
    touched: tuple[tuple[int, float, float], ...] = ()
    """Number of each pose that was left out, from 1, and N, Nm by which it is off what the others predict."""


def identify_poses(
    setup: Setup, poses: Poses, mounting: bool = False, gravity: bool = False
) -> tuple[Identified, PoseReport]:
    """Fit mass, centre of mass and bias to readings at rest, optionally mounting and gravity; the inertia is kept.

    A pose in which something touched the tool is left out: one reading off by newtons would move mass and drift.
    """
    kept, touched, axes = np.arange(len(poses.t)), list[tuple[int, float, float]](), _rotations(setup, poses)
    found, report, errors = _fit(setup, poses, axes, mounting, gravity)
    while len(kept) > FEWEST and len(touched) < MOST_TOUCHED * len(poses.t):
        worst = int((np.abs(errors) / _scale(errors)).max(1).argmax())
        fewer = np.delete(kept, worst)
        rest = poses._replace(t=poses.t[fewer], q=poses.q[fewer], wrench=poses.wrench[fewer])
        without = _fit(setup, rest, axes[fewer], mounting, gravity)
        if (np.abs(errors[worst]) / _scale(without[2])).max() < TOUCHED:
            break
        touched.append((int(kept[worst]) + 1, *np.linalg.norm(errors[worst].reshape(2, 3), axis=1).tolist()))
        kept, (found, report, errors) = fewer, without
    return found, report._replace(touched=tuple(sorted(touched)))


def _scale(errors: Array) -> Array:
    """(6,) robust standard deviations of errors (N, 6)."""
    return MAD * np.median(np.abs(errors), 0) + 1e-12


def _fit(
    setup: Setup, poses: Poses, axes: Array, mounting: bool, gravity: bool
) -> tuple[Identified, PoseReport, Array]:
    """The fit to all of these poses, whose ``_rotations`` are ``axes``, and (N, 6) N, Nm by which each is off what the
    others predict."""
    down, tool = np.asarray(setup.robot.gravity), setup.tool
    s = -np.einsum("nji,j->ni", axes, down)
    std = np.asarray(setup.sensor.noise_std)
    start = likely_rotation(weight_columns(s), poses.wrench, poses.t, std) if mounting else np.eye(3)
    turns = np.repeat([MOUNTING_STD if mounting else FIXED, GRAVITY_STD if gravity else FIXED], 3)
    prior_std = np.concatenate([[20 * tool.mass], [CENTER_STD * tool.mass] * 3, turns, [np.inf] * 6])
    moment = tool.mass * np.asarray(tool.center_of_mass)

    def fit(prior_std: Array, drifts: bool = True) -> Estimate:
        return estimate(Problem(axes, poses.wrench, poses.t, prior_std), tool.mass, moment, down, start, drifts)

    kept = _unknown(fit(prior_std), alone=True)
    prior_std[:4] = np.where(kept, FIXED, prior_std[:4])
    found, plain = fit(prior_std), fit(prior_std, drifts=False)
    report = PoseReport(
        poses=len(poses.t),
        drift=_rms(found.drift[None]),
        enlarged=found.enlarged,
        left_out=_rms(found.left_out),
        plain=np.array([plain.mass, *plain.first_moment / plain.mass]),
        plain_left_out=_rms(plain.left_out),
    )
    return _identified(setup, found, kept, mounting, gravity), report, plain.left_out


def pose_lines(report: PoseReport) -> list[str]:
    """Lines about how well static poses are predicted, and about the result of plain least squares."""
    drift = "constant bias"
    if report.drift.any():
        drift = f"bias drifting by {report.drift[0]:.2g} N, {report.drift[1]:.2g} Nm from pose to pose"
    mass, *center = report.plain
    where = " ".join(f"{1e3 * x:.2f}" for x in center)
    gains = "the axes of force disagree on the mass, by gains that differ or by a drift"
    more = [f"{gains}: errors are enlarged {report.enlarged:.2g} times"] if report.enlarged > 1 else []
    for pose, force, torque in report.touched:
        more.append(f"pose {pose} is left out: {force:.2g} N, {torque:.2g} Nm off what the others predict, touched?")
    return [
        *more,
        f"{report.poses} static poses, {drift}; each predicted from the others: {_errors(report.left_out)}",
        f"plain least squares: {mass:.4f} kg, centre of mass {where} mm, {_errors(report.plain_left_out)}",
    ]


def _errors(rms: np.ndarray) -> str:
    return f"rms {rms[0]:.3g} N, {rms[1]:.2g} Nm"


def _identified(setup: Setup, found: Estimate, kept: Array, mounting: bool, gravity: bool) -> Identified:
    center = found.first_moment / found.mass
    to_sheet = np.zeros((4, 16))
    to_sheet[0, 0] = 1
    to_sheet[1:, 0], to_sheet[1:, 1:4] = -center / found.mass, np.eye(3) / found.mass
    stated = np.array([setup.tool.mass, *setup.tool.center_of_mass, *setup.tool.inertia])
    spread = np.sqrt(np.diag(to_sheet @ found.covariance @ to_sheet.T))
    values = np.concatenate([np.where(kept, stated[:4], [found.mass, *center]), stated[4:]])
    stderr = np.concatenate([np.where(kept, np.nan, spread), np.full(6, np.nan)])
    pulled = _unknown(found) & ~kept
    of_weight = [KEPT if k else PULLED if p else "" for k, p in zip(kept, pulled, strict=True)]
    turn_std = np.sqrt(np.diag(found.covariance))[4:10]
    down = skew(found.gravity)
    gravity_std = np.sqrt(np.diag(down @ found.covariance[7:10, 7:10] @ down.T)) * gravity
    unexcited = [name for name, remark in zip(NAMES, of_weight, strict=False) if remark] + list(NAMES[4:])
    if mounting:
        unexcited += [f"mounting about {x}" for x, e in zip("xyz", turn_std[:3], strict=True) if e > MOUNTING_STD / 2]
    return Identified(
        theta=theta_of(values),
        values=values,
        stderr=stderr,
        rotation=vector_from_rotation(found.rotation),
        rotation_stderr=turn_std[:3] * mounting,
        gravity=found.gravity,
        gravity_stderr=gravity_std,
        condition=condition(_of_weight(found), tool_units(found.mass)[:4]),
        unexcited=unexcited,
        remarks=(*of_weight, *[KEPT] * 6),
        bias=found.bias,
        bias_stderr=found.bias_std,
        converged=found.converged,
    )


def _unknown(found: Estimate, alone: bool = False) -> Array:
    """(4,) whether the poses leave mass and centre of mass undetermined; ``alone``: even with the others known."""
    return np.isin(NAMES[:4], undetermined(_of_weight(found), tool_units(abs(found.mass))[:4], alone))


def _of_weight(found: Estimate) -> Array:
    """(4, 4) information of the poses on mass and first moment, with the bias unknown."""
    own, cross, bias = found.information[:4, :4], found.information[:4, 10:], found.information[10:, 10:]
    return own - cross @ np.linalg.solve(bias, cross.T)


def _rms(errors: Array) -> Array:
    """(2,) root mean square over forces and over torques."""
    return np.sqrt(np.square(errors).reshape(-1, 2, 3).mean((0, 2)))


def _rotations(setup: Setup, poses: Poses) -> Array:
    """(N, 3, 3) axes of the sensor in the base frame."""
    arm = params_from_setup(orientation_alone(setup)).arm
    rest = jnp.zeros(poses.q.shape[1], arm.zero_rotation.dtype)
    q = jnp.asarray(poses.q, arm.zero_rotation.dtype)
    rotation = jax.jit(jax.vmap(lambda q: motion_of(arm, q, rest, rest).R_base_sensor))
    return np.asarray(rotation(q), np.float64)
