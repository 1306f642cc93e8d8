"""The tool's inertial parameters from a log, jointly with the bias: nobody need have measured the tool."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.filtering import innovation_regression, likelihood, pipeline
from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.innovation_regression import Linear, Prior
from ftbias_jax.filtering.pipeline import DEFAULT_OPTIONS, Options
from ftbias_jax.filtering.smoother import smooth_joints
from ftbias_jax.model.kinematics.screws import rotation_from_vector
from ftbias_jax.model.params import Params
from ftbias_jax.model.wrench.inertia import (
    about_center_of_mass,
    log_cholesky_from_parameters,
    parameters_from_log_cholesky,
)
from ftbias_jax.model.wrench.tool_wrench import tool_parameters
from ftbias_jax.types import Array, Sample

MAX_ITERATIONS = 10
RADIUS = 0.05
"""m, size of the sphere a point mass is taken for: log-Cholesky coordinates need a body with volume."""
NAMES = ("mass", "com_x", "com_y", "com_z", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
UNITS = ("kg", "m", "m", "m", *["kg m^2"] * 6)
PRIOR_STD = np.array([3.0, 1.5, 1.5, 1.5, 0.1, 0.1, 0.1, 0.3, 0.3, 0.3])
"""Of the log-Cholesky coordinates: factors for mass and size, m for skew and centre of mass. Wide for any tool."""
MOUNTING_STD, GRAVITY_STD, FIXED = 0.3, 0.1, 1e-9
"""rad, prior of the turns of the sensor on the flange and of gravity; FIXED for what is not asked for."""


class Identified(NamedTuple):
    """An identified tool, and optionally how the sensor is mounted."""

    theta: np.ndarray
    """(10,) inertial parameters (tool_wrench.py)."""
    values: np.ndarray
    """(10,) as NAMES, inertia about the centre of mass."""
    stderr: np.ndarray
    """(10,)."""
    rotation: np.ndarray
    """(3,) rad, rotation vector from the stated to the identified mounting, sensor frame; 0 if not asked for."""
    rotation_stderr: np.ndarray
    gravity: np.ndarray
    """(3,) m/s^2, base frame, of the stated size."""
    gravity_stderr: np.ndarray
    condition: float
    """Condition number of the excitation of theta, in units of the mass and of RADIUS; above 1e3 the motion is poor."""
    unexcited: list[str]
    """What the log alone leaves open: parameters of the tool whose standard error is larger than a tool of size RADIUS
    could have; turns of the sensor and components of gravity, if asked for, that stay half as uncertain as at first."""
    gain: float
    """nats over the start."""
    converged: bool


def identify(
    params: Params,
    samples: Sample,
    options: Options = DEFAULT_OPTIONS,
    mounting: bool = False,
    gravity: bool = False,
) -> Identified:
    """Fit theta to the wrench's likelihood, physically consistent.

    Args:
        params: of the pipeline; params.theta is where to start.
        samples: of one log.
        options: of the pipeline.
        mounting: also fit the sensor's rotation.
        gravity: also fit its direction (its size is kept).
    """
    joints = smooth_joints(params, pipeline.init(params, samples), samples, options)
    problem, _ = likelihood.wrench_problem(params, samples, joints, options)
    model = innovation_regression.linearise(
        problem, lambda z: stages.predict_readings(_moved(params, z), joints.mean, samples)
    )
    log_cholesky = np.asarray(log_cholesky_from_parameters(_with_volume(params.theta)))
    turns = np.repeat([MOUNTING_STD if mounting else FIXED, GRAVITY_STD if gravity else FIXED], 3)
    std = np.concatenate([PRIOR_STD, turns])
    prior = Prior(np.concatenate([log_cholesky, np.zeros(6)]), std)
    x = prior.mean
    linear = model(np.asarray(_physical(jnp.asarray(x))))
    first = cost = (linear.residual**2).sum() / 2
    for _ in range(MAX_ITERATIONS):  # one is enough without mounting and gravity: the wrench is linear in theta
        x = _best_physical(linear, x, prior)
        linear = model(np.asarray(_physical(jnp.asarray(x))))
        before, cost = cost, (linear.residual**2).sum() / 2
        converged = abs(before - cost) < 0.01 * max(1.0, innovation_regression.excess(linear, problem))
        if converged:
            break
    slope = np.asarray(jax.jacfwd(_physical)(jnp.asarray(x)))
    to_sheet = np.asarray(jax.jacfwd(lambda x: _data_sheet(_physical(x)[:10]))(jnp.asarray(x)))
    covariance = innovation_regression.covariance(
        linear._replace(columns=np.einsum("zp,ztc->ptc", slope, linear.columns)),
        samples.dt,
        slope.T @ linear.information @ slope + np.diag(std**-2.0),
    )
    down = np.asarray(jax.jacfwd(lambda z: _moved(params, z).gravity)(jnp.asarray(linear.at)))[:, 13:]
    condition, unexcited = _excitation(linear, innovation_regression.excess(linear, problem))
    rotation_stderr = np.sqrt(np.diag(covariance)[10:13])
    gravity_stderr = np.sqrt(np.diag(down @ covariance[13:, 13:] @ down.T))
    if mounting:
        unexcited += [
            f"mounting about {x}" for x, e in zip("xyz", rotation_stderr, strict=True) if e > MOUNTING_STD / 2
        ]
    if gravity:
        wide = GRAVITY_STD / 2 * np.linalg.norm(params.gravity)
        unexcited += [f"gravity along {x}" for x, e in zip("xyz", gravity_stderr, strict=True) if e > wide]
    return Identified(
        theta=linear.at[:10],
        values=np.asarray(_data_sheet(jnp.asarray(linear.at[:10]))),
        stderr=np.sqrt(np.diag(to_sheet @ covariance @ to_sheet.T)),
        rotation=x[10:13],
        rotation_stderr=rotation_stderr,
        gravity=np.asarray(_moved(params, jnp.asarray(linear.at)).gravity),
        gravity_stderr=gravity_stderr,
        condition=condition,
        unexcited=unexcited,
        gain=float(first - cost),
        converged=converged,
    )


def _best_physical(linear: Linear, x: np.ndarray, prior: Prior) -> np.ndarray:
    """Minimum of the linearised problem over physically consistent tools: Levenberg-Marquardt without the data."""

    def cost(x: np.ndarray) -> float:
        move = np.asarray(_physical(jnp.asarray(x))) - linear.at
        return float(move @ (pull + linear.information @ move / 2) + (((x - prior.mean) / prior.std) ** 2).sum() / 2)

    pull = np.einsum("ptc,tc->p", linear.columns, linear.residual)
    current, damping, weight = cost(x), 1e-3, prior.std**-2.0
    for _ in range(500):
        z, slope = (np.asarray(value) for value in _physical_and_slope(jnp.asarray(x)))
        gradient = slope.T @ (pull + linear.information @ (z - linear.at)) + weight * (x - prior.mean)
        normal = slope.T @ linear.information @ slope + np.diag(weight)
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
        trial = x - step / max(1.0, np.abs(step / prior.std).max())  # logarithms: a long step would overflow
        new = cost(trial)
        if new < current:
            gained, x, current, damping = current - new, trial, new, damping / 10
            if gained < 1e-6 * max(1.0, abs(current)):
                break
        else:
            damping *= 10
            if damping > 1e12:
                break
    return x


def _physical(x: Array) -> Array:
    """(16,) log-Cholesky coordinates, turn of the sensor, turn of gravity -> the same with theta in front."""
    return jnp.concatenate([parameters_from_log_cholesky(x[:10]), x[10:]])


@jax.jit
def _physical_and_slope(x: Array) -> tuple[Array, Array]:
    return _physical(x), jax.jacfwd(_physical)(x)


def _moved(params: Params, z: Array) -> Params:
    """Parameters at (16,): theta, rotation vector of the sensor, rotation vector of gravity."""
    arm = params.arm._replace(zero_rotation=params.arm.zero_rotation @ rotation_from_vector(z[10:13]))
    return params._replace(arm=arm, gravity=rotation_from_vector(z[13:16]) @ params.gravity, theta=z[:10])


def _excitation(linear: Linear, scatter: float) -> tuple[float, list[str]]:
    """What the motion says about theta by itself, in units of a tool of this mass and of size RADIUS."""
    units = linear.at[0] * np.array([1.0, *[RADIUS] * 3, *[RADIUS**2] * 6])
    strength, directions = np.linalg.eigh(linear.information[:10, :10] * units[:, None] * units)
    strength = np.maximum(strength, 1e-12 * strength[-1])
    variance = max(1.0, scatter) * (directions**2 / strength).sum(1)
    unexcited = [name for name, spread in zip(NAMES, variance, strict=True) if spread > 1]
    return float(np.sqrt(strength[-1] / strength[0])), unexcited


def _data_sheet(theta: Array) -> Array:
    """(10,) as NAMES: mass, centre of mass, inertia about it."""
    mass, center, inertia = about_center_of_mass(theta)
    return jnp.concatenate([mass[None], center, inertia])


def _with_volume(theta: Array) -> Array:
    """The same mass and centre of mass with the inertia of a sphere, if the stated one is that of a point or a rod."""
    mass, center, inertia = about_center_of_mass(theta)
    sphere = 0.4 * mass * RADIUS**2
    principal = jnp.linalg.eigvalsh(jnp.stack([inertia[jnp.array(row)] for row in ((0, 1, 2), (1, 3, 4), (2, 4, 5))]))
    thick = principal[0] + principal[1] - principal[2] > 1e-3 * sphere
    round_inertia = sphere * jnp.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0])
    return tool_parameters(mass, center, jnp.where(thick, inertia, round_inertia))
