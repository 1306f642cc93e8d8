"""Identification of the tool's inertial parameters from a log, jointly with the bias; the tool need not be measured."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.calibration.tool import physical, shown
from ftbias_jax.calibration.tool.mounting import likely_rotation
from ftbias_jax.calibration.tool.physical import FIXED, NAMES, PRIOR_STD
from ftbias_jax.filtering import innovation_regression, likelihood
from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.innovation_regression import Linear, Prior
from ftbias_jax.filtering.pipeline import DEFAULT_OPTIONS, Options
from ftbias_jax.filtering.smoother import smoothed_joints
from ftbias_jax.model.kinematics.recorded_pose import FreeBody
from ftbias_jax.model.kinematics.screws import rotation_from_vector
from ftbias_jax.model.params import Params
from ftbias_jax.model.wrench.inertia import without_round_off
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.setup import rotations
from ftbias_jax.types import Array, Gaussian, Sample

MAX_ITERATIONS = 10
MOUNTING_STD, GRAVITY_STD = 0.3, 0.1
"""rad, prior standard deviations of the sensor's rotation about the likely axis-parallel one, and of gravity's."""
LEVER_STD, TRANSLATION_STD = 0.5, 0.1
"""m, prior standard deviations of the lever arm of a sensor without recorded position (distance to the point it turns
about, of an arm's joints) and of one whose place on the flange is not stated. The acceleration at a lever arm varies
with the orientation; if it is not fitted, it is mistaken for weight and inertia."""
OF_GRAVITY, OF_LEVER = slice(13, 16), slice(16, 19)
"""Coordinates of a fit, after those of the tool and of the rotation of the sensor."""
KEPT = "not determined by this motion, kept"
PULLED = "not determined by this motion, as near to the setup as the others let it"
NO_BETTER = "predicts unseen blocks no better than the setup's, kept"


class Identified(NamedTuple):
    """An identified tool, and optionally how the sensor is mounted."""

    theta: np.ndarray
    """(10,) inertial parameters (tool_wrench.py)."""
    values: np.ndarray
    """(10,) in the order of NAMES, inertia about the centre of mass."""
    stderr: np.ndarray
    """(10,) standard errors of ``values``; NaN where the setup's value is kept."""
    rotation: np.ndarray
    """(3,) rad, rotation vector from the stated to the identified mounting, sensor frame; 0 if not asked for."""
    rotation_stderr: np.ndarray
    gravity: np.ndarray
    """(3,) m/s^2, base frame, of the stated magnitude."""
    gravity_stderr: np.ndarray
    condition: float
    """Condition number of the excitation of theta, in units of the mass and of RADIUS; above 1e3 it is poor."""
    unexcited: list[str]
    """What the log alone does not determine: parameters of the tool whose standard error is larger than half of what a
    tool of size RADIUS could have; rotations of the sensor and components of gravity, if fitted, with a standard error
    above half their prior."""
    remarks: tuple[str, ...]
    """(10) reason why each parameter is not identified; "" = identified."""
    bias: np.ndarray
    """(6,) N, Nm at the end of the log, in the report's sign: unbiased = measured + bias."""
    bias_stderr: np.ndarray
    """(6,) N, Nm."""
    excess: float = np.nan
    """Root mean square of the remaining innovations, in standard deviations of the setup's noise."""
    dispersion: float = 1.0
    """Factor by which blocks of the log scatter more than the setup's noise explains; standard errors include it."""
    gain: float = np.nan
    """nats gained over the start, divided by the overdispersion of the log."""
    converged: bool = False
    lever: np.ndarray = np.zeros(0)
    """(3,) m: sensor origin beyond the stated one, or for a recorded orientation beyond the point that it turns about;
    in axes of the stated sensor, or of the mount whose pose is recorded; (0,): not fitted."""
    lever_stderr: np.ndarray = np.zeros(0)
    has_lever: bool = False
    """Whether held-out blocks are predicted better with the lever arm."""
    model_stderr: np.ndarray = np.zeros(6)
    """(6,) N, Nm: standard error of the reading, root mean square over the log, due to rotations and lever arm."""
    left: np.ndarray = np.zeros((0, 6))
    """(T, 6) N, Nm: residual of the reading with the identified tool, NaN = not measured; (0, 6) for static poses."""


def identify(
    params: Params,
    samples: Sample,
    options: Options = DEFAULT_OPTIONS,
    mounting: bool = False,
    gravity: bool = False,
    translation: bool = False,
) -> Identified:
    """Fit theta to the likelihood of the wrench, physically consistent; parameters that the log leaves open are kept.

    Args:
        params: parameters of the pipeline; params.theta is the start of the search, and is kept where undetermined.
        samples: samples of one log.
        options: options of the pipeline.
        mounting: also fit the sensor's rotation.
        gravity: also fit the direction of gravity (its magnitude is kept).
        translation: also fit the place of the sensor on the flange; the lever arm of a sensor of which only the
            orientation is recorded is always fitted.
    """
    joints = smoothed_joints(params.joint, *samples[:3], model=options.joint_model)
    quarter = _axis_aligned_mounting(params, joints, samples) if mounting else np.eye(3)
    params = _turned(params, quarter)
    moves = [MOUNTING_STD if mounting else FIXED, GRAVITY_STD if gravity else FIXED]
    if isinstance(params.arm, FreeBody) and samples.q.shape[1] == len("wxyz"):
        moves.append(LEVER_STD)
    elif translation:
        moves.append(TRANSLATION_STD)
    if only_theta := max(moves) <= FIXED:
        moves = []
    std = np.concatenate([PRIOR_STD, np.repeat(moves, 3)])
    prior = Prior(np.pad(physical.coordinates(params.theta), (0, len(std) - len(PRIOR_STD))), std)
    dt = np.asarray(samples.dt)
    x = prior.mean

    def model(x: np.ndarray) -> Linear:
        z = physical.parameters_at(x)
        return jax.tree.map(np.asarray, _linearised(z, params, joints, samples, options=options))

    first = model(x)
    linear, parts, converged = first, shown.in_blocks(first, dt), only_theta  # the wrench is linear in theta
    for _ in range(0 if only_theta else MAX_ITERATIONS):
        x, before = physical.most_likely(physical.total(parts), x, prior), linear.cost
        linear = model(x)
        parts = shown.in_blocks(linear, dt)
        converged = abs(before - linear.cost) < 0.01 * shown.overdispersion(parts, x, prior)
        if converged:
            break
    stated = without_round_off(physical.data_sheet(params.theta))
    found = shown.judge(parts, x, prior, stated[4:])
    has_lever = len(x) > OF_LEVER.start and shown.predicts_unseen(parts, found, OF_LEVER)
    linear = first.moved(physical.parameters_at(found.x)) if only_theta else model(found.x)
    wrench = np.asarray(samples.wrench)

    def left(z: np.ndarray) -> np.ndarray:
        return wrench - np.asarray(_readings(jnp.asarray(z), params, joints.mean, samples))

    return _identified(params, quarter, linear, found, dt, stated, mounting, gravity, left)._replace(
        excess=float(np.sqrt(2 * linear.cost / np.isfinite(wrench).sum())),
        dispersion=found.dispersion,
        gain=(first.cost - linear.cost) / found.dispersion,
        converged=converged,
        has_lever=has_lever,
    )


@keep_program("options")
def _linearised(z: Array, params: Params, joints: Gaussian, samples: Sample, *, options: Options) -> Linear:
    problem, _ = likelihood.wrench_problem(params, samples, joints, options)
    return innovation_regression.linearise(problem, lambda z: _readings(z, params, joints.mean, samples), z)


@keep_program()
def _readings(z: Array, params: Params, joints: Array, samples: Sample) -> Array:
    """(T, 6) N, Nm: predicted reading at parameters z (P,) as of ``_moved`` and joints (T, n, 3)."""
    return stages.predict_readings(_moved(params, z), joints, samples)


def _identified(
    params: Params,
    quarter: np.ndarray,
    linear: Linear,
    found: shown.Shown,
    dt: np.ndarray,
    stated: np.ndarray,
    mounting: bool,
    gravity: bool,
    left_at: Callable[[np.ndarray], np.ndarray],
) -> Identified:
    x, std = jnp.asarray(found.x), found.prior.std
    slope = physical.jacobian_of_physical(found.x)
    honest = physical.total(shown.in_blocks(linear, dt)).scaled(1 / found.dispersion)
    tempered = linear._replace(
        columns=np.einsum("zp,ztc->ptc", slope, linear.columns) / np.sqrt(found.dispersion),
        residual=linear.residual / np.sqrt(found.dispersion),
    )
    normal = slope.T @ honest.information @ slope + np.diag(std**-2.0)
    covariance = innovation_regression.covariance(tempered, dt, normal)
    to_sheet = np.asarray(physical.jacobian_of_data_sheet(x))
    values = np.asarray(physical.data_sheet(jnp.asarray(linear.at[:10])))
    stderr = np.sqrt(np.diag(to_sheet @ covariance @ to_sheet.T))
    mass = stated[0] if "mass" in found.kept else values[0]
    units = physical.tool_units(mass, values[[4, 7, 9]].max())
    open_ = shown.undetermined(honest.information, units if found.inertia else units[:4])
    remarks = tuple(_remark(name, found, open_) for name in NAMES)
    kept = np.array([remark in (KEPT, NO_BETTER) for remark in remarks])
    values, stderr = np.where(kept, stated, values), np.where(kept, np.nan, stderr)
    to_bias = linear.bias_slopes.T @ slope
    bias_variance = found.dispersion * linear.bias_variance + np.einsum("ap,pq,aq->a", to_bias, covariance, to_bias)
    free = np.flatnonzero(std[10:] > FIXED) + 10
    left = left_at(linear.at)
    model_stderr = np.zeros(6)
    if len(free):
        rows, steps = np.isfinite(left).any(1), _steps(covariance, free, linear.at)
        columns = np.stack([(left_at(linear.at + step) - left)[rows] for step in steps])
        model_stderr = innovation_regression.stderr_of_reading(columns, np.eye(len(free)))
    missing = max(0, OF_GRAVITY.stop - len(x))  # rotations that are not fitted are zero, without error
    at, covariance = np.pad(linear.at, (0, missing)), np.pad(covariance, (0, missing))
    down, to_down = (np.asarray(x) for x in _gravity_and_jacobian(params.gravity, jnp.asarray(at[OF_GRAVITY])))
    rotation_stderr = np.sqrt(np.diag(covariance)[10:13])
    lever, lever_stderr = linear.at[OF_LEVER], np.sqrt(np.diag(covariance)[OF_LEVER])
    if len(lever) and not isinstance(params.arm, FreeBody):
        lever, lever_stderr = quarter @ lever, np.abs(quarter) @ lever_stderr
    gravity_stderr = np.sqrt(np.diag(to_down @ covariance[OF_GRAVITY, OF_GRAVITY] @ to_down.T))
    unexcited = [name for name, remark in zip(NAMES, remarks, strict=True) if remark in (KEPT, PULLED)]
    if mounting:
        unexcited += [
            f"mounting about {x}" for x, e in zip("xyz", rotation_stderr, strict=True) if e > MOUNTING_STD / 2
        ]
    if gravity:
        wide = GRAVITY_STD / 2 * np.linalg.norm(params.gravity)
        unexcited += [f"gravity along {x}" for x, e in zip("xyz", gravity_stderr, strict=True) if e > wide]
    turned = quarter @ rotations.rotation_from_vector(at[10:13])
    elapsed = dt.sum()
    return Identified(
        theta=physical.theta_of(values),
        values=values,
        stderr=stderr,
        rotation=rotations.vector_from_rotation(turned),
        rotation_stderr=rotation_stderr,
        gravity=down,
        gravity_stderr=gravity_stderr,
        lever=lever,
        lever_stderr=lever_stderr,
        model_stderr=model_stderr,
        left=left,
        condition=shown.condition(linear.information, physical.tool_units(linear.at[0])),
        unexcited=unexcited,
        remarks=remarks,
        bias=np.asarray(params.bias.prior_mean[:6] + elapsed * params.bias.prior_mean[6:]) + linear.bias,
        bias_stderr=np.sqrt(bias_variance),
    )


def _steps(covariance: np.ndarray, free: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(k, P) uncorrelated steps, a standard deviation long, of coordinates (k,) of a fit at z (P,) given all others."""
    given = np.setdiff1d(np.arange(len(covariance)), free)
    variance, directions = np.linalg.eigh(innovation_regression.conditional(covariance, free, given))
    steps = np.zeros((len(free), len(at)))
    steps[:, free] = (directions * np.sqrt(np.maximum(variance, 0))).T
    return steps


def _remark(name: str, found: shown.Shown, open_: tuple[str, ...]) -> str:
    if name.startswith("I") and not found.inertia:
        return KEPT if name in found.poor else NO_BETTER
    if name in found.kept and not name.startswith("I"):
        return KEPT
    return PULLED if name in open_ else ""


def _axis_aligned_mounting(params: Params, joints: Gaussian, samples: Sample) -> np.ndarray:
    """Axis-parallel rotation from which the mounting is searched (``likely_rotation``)."""
    t, std = np.cumsum(np.asarray(samples.dt)), np.sqrt(np.asarray(params.bias.wrench_variance))
    columns = np.asarray(_columns_of_weight(params, joints.mean, samples))
    return likely_rotation(columns, np.asarray(samples.wrench), t, std)


@jax.jit
def _columns_of_weight(params: Params, joints: Array, samples: Sample) -> Array:
    """(T, 6, 4) derivatives of the reading with respect to mass and first moment."""

    def reading(theta: Array) -> Array:
        return stages.predict_readings(params._replace(theta=theta), joints, samples)

    return jax.jacfwd(reading)(params.theta)[..., :4]


def _turned(params: Params, rotation: np.ndarray) -> Params:
    turned = params.arm.zero_rotation @ jnp.asarray(rotation, params.theta.dtype)
    return params._replace(arm=params.arm._replace(zero_rotation=turned))


def _moved(params: Params, z: Array) -> Params:
    """Parameters at (P,): theta; optionally rotation vectors of the sensor and of gravity; and optionally the lever arm
    of the sensor, in axes of the stated sensor or of the mount whose orientation is recorded."""
    params = params._replace(theta=z[:10])
    if z.shape[0] == 10:
        return params
    arm = params.arm._replace(zero_rotation=params.arm.zero_rotation @ rotation_from_vector(z[10:13]))
    if z.shape[0] > OF_LEVER.start:
        in_sensor = not isinstance(arm, FreeBody)
        lever = params.arm.zero_rotation @ z[OF_LEVER] if in_sensor else z[OF_LEVER]
        arm = arm._replace(zero_position=arm.zero_position + lever)
    return params._replace(arm=arm, gravity=_turned_gravity(params.gravity, z[OF_GRAVITY]))


def _turned_gravity(gravity: Array, turn: Array) -> Array:
    return rotation_from_vector(turn) @ gravity


@keep_program()
def _gravity_and_jacobian(gravity: Array, turn: Array) -> tuple[Array, Array]:
    """(3,) m/s^2: gravity turned by a rotation vector, and (3, 3) its derivative with respect to that vector."""
    return _turned_gravity(gravity, turn), jax.jacfwd(_turned_gravity, argnums=1)(gravity, turn)
