"""Wrench that a user's MuJoCo scene predicts for a recorded motion, and a log to be diagnosed against it.

The wrench is computed by inverse dynamics at the smoothed joint states of the log. Sprung joints distal of the sensor
move according to their springs; other joints that are not in the log stay where the scene has them.
"""

import os
from collections.abc import Callable
from typing import Any

import numpy as np

from ftbias_jax.diagnosis.samples.smoothed import padded_samples
from ftbias_jax.errors import LogError
from ftbias_jax.filtering import params_for_log
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.filtering.smoother import smoothed_joints
from ftbias_jax.io.cleaning import clean
from ftbias_jax.io.log import Column, Log
from ftbias_jax.io.tables.array_files import load_arrays
from ftbias_jax.model.effects.compose import EXTRA_WRENCH, tool_wrenches
from ftbias_jax.model.effects.types import Model, Signals
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.setup.mjcf import Mjcf
from ftbias_jax.setup.types import Setup, sign_of
from ftbias_jax.types import Array

MODEL = tuple(name.replace("beyond", "wrench_model") for name in EXTRA_WRENCH)
"""Names in [log.columns] of the wrench that a simulator predicts for the log, N and Nm."""
EVERY = 1000
"""Number of samples between two reports of progress."""
STEP, MOST_STEPS = 0.05, 100
"""Maximum phase, rad, of the fastest mode per integration step, and maximum number of steps per sample."""
SETTLING = 30
"""Number of fixed-point iterations; each multiplies the error by the stiffness of gravity relative to the springs."""


@in_float64
def joint_states(setup: Setup, log: Log) -> Array:
    """(T, n, 3) rad, rad/s, rad/s^2, smoothed joint positions, velocities, accelerations at a cleaned log's stamps."""
    options, samples = Options(joint_model=setup.joints.model), padded_samples(log)
    params = params_for_log.max_likelihood_params(setup, samples, options)
    joints = smoothed_joints(params.joint, *samples[:3], model=options.joint_model)
    return np.asarray(joints.mean)[: len(log.t)]


def replay(scene: Mjcf, t: Array, states: Array, progress: Callable[[float], object] = lambda done: None) -> Array:
    """(T, 6) N, Nm: the wrench that the sensor exerts on the tool, at the scene's site.

    The states (T, n, 3) at t (T,) s are those of ``joint_states``; ``progress`` is called with the samples done so far.

    Raises:
        SetupError: the scene has another number of joints.
    """
    import mujoco

    model, data, joints = scene.model, scene.in_reference_pose(), list(scene.joints)
    if len(joints) != states.shape[1]:
        message = f"has {len(joints)} joints before the sensor, the log {states.shape[1]}"
        raise scene.error("robot", message, "choose the scene of this robot, or its base_link")
    at, speed, springs = model.jnt_qposadr[joints], model.jnt_dofadr[joints], _springs(scene)
    wrench, reading = np.zeros((len(t), 6)), np.zeros(6)
    for i, dt in enumerate(np.diff(t, prepend=t[:1]).tolist()):
        data.qpos[at], data.qvel[speed], data.qacc[speed] = states[i].T
        if not i:
            _settle(model, data, springs)
        _swing(model, data, springs, dt)
        mujoco.mj_inverse(model, data)
        mujoco.mj_rnePostConstraint(model, data)
        origin = data.subtree_com[model.body_rootid[scene.body]]
        place = data.site_xpos[scene.site], origin, data.site_xmat[scene.site]
        mujoco.mju_transformSpatial(reading, data.cfrc_int[scene.body], 1, *place)
        wrench[i] = np.roll(reading, 3)  # MuJoCo puts the torque first
        if i % EVERY == 0:
            progress(i)
    return wrench


def _springs(scene: Mjcf) -> Array:
    """Degrees of freedom of sprung hinges and slides distal of the sensor."""
    model = scene.model
    beyond = np.isin(model.jnt_bodyid, scene.distal_bodies()) & ~np.isin(np.arange(model.njnt), scene.joints)
    single = model.jnt_type >= 2  # slides and hinges
    return np.asarray(model.jnt_dofadr[beyond & single & (model.jnt_stiffness > 0)])


def _settle(model: Any, data: Any, springs: Array) -> None:
    """Move sprung joints to their equilibrium, which they reached long before a recording begins."""
    import mujoco

    joints = model.dof_jntid[springs]
    data.qvel[springs] = data.qacc[springs] = 0.0
    for _ in range(SETTLING if len(springs) else 0):
        mujoco.mj_inverse(model, data)  # joint forces that springs and dampers lack for equilibrium
        data.qpos[model.jnt_qposadr[joints]] -= data.qfrc_inverse[springs] / model.jnt_stiffness[joints]


def _swing(model: Any, data: Any, springs: Array, dt: float) -> None:
    """Integrate the sprung joints over one sample, and set their acceleration at its end.

    With the arm's accelerations given, M_ss a_s = tau_s - bias_s - M_sa a_a. The steps are short against the fastest
    mode, symplectic, and implicit in the dampers; within a sample, only the forces of springs and dampers change.
    """
    if not len(springs):
        return
    import mujoco

    joints = model.dof_jntid[springs]
    stiffness, damping = model.jnt_stiffness[joints], np.diag(model.dof_damping[springs])
    units, rows = np.eye(model.nv)[springs], np.zeros((len(springs) + 1, model.nv))
    data.qacc[springs] = 0.0
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    for row, vector in zip(rows, (*units, data.qacc), strict=True):
        mujoco.mj_mulM(model, data, row, vector)  # access to the mass matrix in every version of MuJoCo
    mass, force = rows[:-1, springs], (data.qfrc_passive - data.qfrc_bias - rows[-1])[springs]
    fastest = np.sqrt(np.linalg.eigvals(np.linalg.solve(mass, np.diag(stiffness))).real.max())
    steps = min(max(int(np.ceil(fastest * dt / STEP)), 1), MOST_STEPS)
    h, start = dt / steps, data.qvel[springs].copy()
    inverse, velocity, moved = np.linalg.inv(mass + h * damping), start, np.zeros(len(springs))
    for _ in range(steps):
        acceleration = inverse @ (force - stiffness * moved - damping @ (velocity - start))
        velocity = velocity + h * acceleration
        moved = moved + h * velocity
    data.qpos[model.jnt_qposadr[joints]] += moved
    data.qvel[springs], data.qacc[springs] = velocity, acceleration


@in_float64
def against(setup: Setup, log: Log, t: Array, wrench: Array, states: Array | None = None) -> Log:
    """Log to be diagnosed against a simulator, with columns of the simulated minus the nominal tool's wrench.

    The simulated wrench (K, 6) N, Nm, on the tool, sensor frame, has stamps t (K,) s since the log's first sample; the
    states are those of ``joint_states``, computed if None.

    Raises:
        LogError: the simulated wrench does not cover the whole log, or has samples that are not finite.
    """
    wrench, t = np.asarray(wrench, float), np.asarray(t, float)
    if wrench.shape != (len(t), 6) or not np.isfinite(wrench).all():
        remedy = "give (T,) seconds and (T, 6) finite numbers"
        raise LogError(f"has shape {wrench.shape}, or NaN", file=log.file, field="wrench_model", remedy=remedy)
    if t[0] > log.t[0] + 0.1 or t[-1] < log.t[-1] - 0.1:
        message = f"lasts from {t[0]:.6g} s to {t[-1]:.6g} s, the log from {log.t[0]:.6g} s to {log.t[-1]:.6g} s"
        raise LogError(message, file=log.file, field="wrench_model", remedy="ftbias replay LOG makes one for it")
    whole = clean(log)
    states = joint_states(setup, whole) if states is None else states
    params, (q, dq, ddq) = params_from_setup(setup), np.moveaxis(states, 2, 0)
    model = Model(params.arm, params.gravity, params.theta)
    nominal = np.asarray(tool_wrenches(Signals(whole.t, q, dq, ddq, 0 * whole.t, model)))
    columns = {
        name: Column(whole.t, np.interp(whole.t, t, wrench[:, k]) - nominal[:, k])
        for k, name in enumerate(EXTRA_WRENCH)
    }
    return log._replace(columns={**log.columns, **columns})


def against_columns(setup: Setup, log: Log) -> Log:
    """``against`` with the wrench that a log may have in its columns ``MODEL``, in the sign that the sensor reports.

    Raises:
        LogError: some of the six columns are missing, or do not cover the whole log.
    """
    there = [log.columns[name] for name in MODEL if name in log.columns]
    if not there:
        return log
    if len(there) < len(MODEL):
        remedy = f"name all six in [log.columns]: {', '.join(MODEL)}"
        raise LogError(f"has {len(there)} of six columns", file=log.file, field="wrench_model", remedy=remedy)
    t = there[0].t
    return against(setup, log, t, sign_of(setup.sensor.reports) * np.stack([column.at(t) for column in there], 1))


def read_against(path: str | os.PathLike[str], setup: Setup, log: Log) -> Log:
    """``against`` with the wrench of an .npz file.

    The file has ``t`` (K,) s, stamps of the log or seconds since its first, and ``wrench_model`` (K, 6) N, Nm in the
    sign that the sensor reports.

    Raises:
        LogError: the file cannot be read, or belongs to another log.
    """
    arrays = load_arrays(path, ("t", "wrench_model"))
    for name in ("t", "wrench_model"):
        if name not in arrays:
            raise LogError("is not there", file=path, field=name, remedy="ftbias replay LOG -o SIM.npz writes it")
    t = np.asarray(arrays["t"], float)
    if len(t) and abs(t[0] - log.start) < abs(t[0]):
        t = t - log.start
    wrench = sign_of(setup.sensor.reports) * np.asarray(arrays["wrench_model"], float)
    return against(setup, log._replace(file=str(path)), t, wrench)
