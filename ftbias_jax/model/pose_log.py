"""Simulated logs of a sensor whose pose is recorded: its tumbling motion, and the recorded arrays."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ftbias_jax.io.log import Log
from ftbias_jax.io.pose import STANDARD_GRAVITY, pose_entries, rotate
from ftbias_jax.model.kinematics.recorded_pose import FreeBody, body_motions
from ftbias_jax.model.simulate import Simulation
from ftbias_jax.model.trajectories import Trajectory
from ftbias_jax.setup.recorded import LENGTH_UNITS, PoseSetup
from ftbias_jax.setup.rotations import rpy_from_rotation, vector_from_rotation
from ftbias_jax.setup.types import Setup

TURNS, SHIFTS = 1.2, 0.15
"""rad about three axes, m along them: excursions of a simulated motion, within the range of a wrist."""
Generate = Callable[[Array, Array, Array, Array], Trajectory]
"""(key, t, center, excursion) -> motion of one independent coordinate per entry of ``center`` (``trajectories``)."""


def tumbling(generate: Generate, key: Array, t: Float[Array, " T"], entries: int) -> Trajectory:
    """Motion at t (T,) s that rotates about three axes and translates along three, as 4 or 7 entries of a pose.

    The entries are a quaternion (w, x, y, z) and, if there are 7, a position; ``generate`` makes angles and positions.
    """
    count = entries - 1  # three angles, and three positions if there are any
    excursion = jnp.asarray([TURNS] * 3 + [SHIFTS] * 3, t.dtype)[:count]
    motion = generate(key, t, jnp.zeros(count, t.dtype), excursion)

    def velocity(x: Array, dx: Array) -> tuple[Array, Array]:
        return jax.jvp(_entries, (x,), (dx,))

    def states(x: Array, dx: Array, ddx: Array) -> tuple[Array, Array, Array]:
        (q, dq), (_, ddq) = jax.jvp(velocity, (x, dx), (dx, ddx))
        return q, dq, ddq

    return Trajectory(t, *jax.vmap(states)(*motion[1:]))


def _entries(x: Array) -> Array:
    """Quaternion of rotations about x, then y, then z by (3,) rad, followed by the position (3,) m, if there is one."""
    (cx, cy, cz), (sx, sy, sz) = jnp.cos(x[:3] / 2), jnp.sin(x[:3] / 2)
    w = cx * cy * cz + sx * sy * sz
    v = [sx * cy * cz - cx * sy * sz, cx * sy * cz + sx * cy * sz, cx * cy * sz - sx * sy * cz]
    return jnp.concatenate([jnp.stack([w, *v]), x[3:]])


def recorded_arrays(
    setup: Setup, made: Simulation, trajectory: Trajectory, body: FreeBody, key: Array
) -> dict[str, np.ndarray]:
    """Arrays that a recording of the simulated log has of its motion, under the names of the native format.

    The entries of the pose have their noise already, that of the gyroscope is drawn here, and a simulated accelerometer
    has none.
    """
    pose = setup.pose
    assert pose is not None
    degrees = 180 / np.pi if setup.log.angle_unit == "deg" else 1.0
    quaternion = np.asarray(made.q[:, :4])
    quaternion = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
    back = quaternion * np.array([1.0, -1, -1, -1])
    arrays = {"orientation": _as_stated(back if pose.conjugate else quaternion, pose, degrees)}
    if pose.linear == "position":
        position = np.asarray(made.q[:, 4:])
        position = rotate(back, position) if pose.position_axes == "body" else position
        arrays["position"] = position / LENGTH_UNITS[setup.log.length_unit]
    if pose.linear == "specific_force":
        motion = body_motions(body, *(x.T for x in trajectory[1:]))
        force = motion.acceleration - jnp.asarray(setup.robot.gravity)[:, None]
        felt = (jnp.einsum("jit,jt->ti", motion.sensor_rotation, x) for x in (motion.angular_velocity, force))
        turning, pushing = (np.asarray(x) for x in felt)
        std = 2 * setup.joints.velocity_noise_std[0]  # A quaternion changes by half of the angle.
        noise = np.asarray(jax.random.normal(jax.random.fold_in(key, 1), turning.shape))
        if pose.gyroscope:
            arrays["angular_velocity"] = degrees * (turning + std * noise) @ pose.imu_rotation
        gravities = STANDARD_GRAVITY if setup.log.acceleration_unit == "g" else 1.0
        arrays["specific_force"] = pushing @ pose.imu_rotation / gravities
    return arrays


def entries_of(setup: Setup, t: np.ndarray, arrays: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Entries of the pose and their rates, as a log reader computes them from these arrays."""
    flat = {name: values.reshape(len(values), -1) for name, values in arrays.items()}
    pose = np.concatenate([flat[name] for name in ("orientation", "position") if name in flat], 1)
    rates = [flat[name] for name in ("angular_velocity", "specific_force") if name in flat]
    return pose_entries(pose, np.concatenate(rates, 1) if rates else None, t, setup)[:2]


def with_positions(log: Log) -> Log:
    """Log with missing positions filled by integration of its recorded velocities, so that it can be replayed."""
    if log.q.shape[1] < 7 or np.isfinite(log.q[1:, 4:]).any():
        return log
    rows = np.flatnonzero(np.isfinite(log.dq[:, 4:]).all(1))
    velocity = np.stack([np.interp(log.t, log.t[rows], column[rows]) for column in log.dq[:, 4:].T], 1)
    steps = (velocity[1:] + velocity[:-1]) / 2 * np.diff(log.t)[:, None]
    position = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, 0)])
    return log._replace(q=np.concatenate([log.q[:, :4], position], 1))


def _as_stated(quaternion: np.ndarray, pose: PoseSetup, degrees: float) -> np.ndarray:
    """Quaternions (T, 4) w, x, y, z in the order or representation of the setup; angles in rad times ``degrees``."""
    if pose.orientation == "quaternion_xyzw":
        return quaternion[:, [1, 2, 3, 0]]
    if pose.orientation == "quaternion_wxyz":
        return quaternion
    columns = [rotate(quaternion, np.broadcast_to(axis, (len(quaternion), 3))) for axis in np.eye(3)]
    matrices = np.stack(columns, 2)
    if pose.orientation != "matrix":
        angles_of = rpy_from_rotation if pose.orientation == "rpy" else vector_from_rotation
        return degrees * np.stack([angles_of(matrix) for matrix in matrices])
    return matrices
