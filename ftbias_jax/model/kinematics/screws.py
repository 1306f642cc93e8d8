"""Kinematics of a serial arm from its screw axes: pose, Jacobian, twist and acceleration.

Conventions (report, section 2). Everything is expressed in the base frame; six-vectors are (linear; angular).
A revolute joint with unit axis s through the point r has the screw (-s x r; s) at q = 0, a prismatic one (d; 0).
R_base_sensor and p_base_sensor are the pose of the sensor frame.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float


class Arm(NamedTuple):
    """A serial arm."""

    linear: Float[Array, "n 3"]
    """(n, 3) linear part v of each screw."""
    angular: Float[Array, "n 3"]
    """(n, 3) angular part s of each screw, of unit length; zero for a prismatic joint."""
    zero_position: Float[Array, " 3"]
    """(3,) m, sensor origin at q = 0."""
    zero_rotation: Float[Array, "3 3"]
    """(3, 3) sensor axes at q = 0."""


class Motion(NamedTuple):
    """Pose, twist and acceleration of the sensor frame with respect to the base, in base coordinates."""

    R_base_sensor: Float[Array, "3 3"]
    p_base_sensor: Float[Array, " 3"]
    """(3,) m."""
    linear_velocity: Float[Array, " 3"]
    """(3,) m/s, of the sensor origin."""
    angular_velocity: Float[Array, " 3"]
    """(3,) rad/s."""
    linear_acceleration: Float[Array, " 3"]
    """(3,) m/s^2, of the sensor origin; coordinate acceleration, gravity is not in it."""
    angular_acceleration: Float[Array, " 3"]
    """(3,) rad/s^2."""
    jacobian: Float[Array, "6 n"]
    """(6, n) sensor Jacobian."""


def skew(v: Float[Array | np.ndarray, "... 3"]) -> Float[Array, "... 3 3"]:
    """Matrix [v] of the cross product, [v] w = v x w; (..., 3) -> (..., 3, 3)."""
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    zero = jnp.zeros_like(x)
    rows = [jnp.stack(row, -1) for row in ((zero, -z, y), (z, zero, -x), (-y, x, zero))]
    return jnp.stack(rows, -2)


def rotation_from_vector(vector: Float[Array | np.ndarray, " 3"]) -> Float[Array, "3 3"]:
    """exp([r]) (3, 3) of a rotation vector (3,) rad; exact value and derivative at zero too.

    sin(a)/a and (1 - cos a)/a^2 are functions of a^2, written so that neither they nor their derivatives divide by
    zero: below 1e-2 rad^2 they are computed by their series, accurate to 1e-13 there.
    """
    a2 = vector @ vector
    small = a2 < 1e-2
    safe2 = jnp.where(small, 1, a2)
    safe = jnp.sqrt(safe2)
    sine = jnp.where(small, 1 - a2 / 6 * (1 - a2 / 20 * (1 - a2 / 42 * (1 - a2 / 72))), jnp.sin(safe) / safe)
    versine = jnp.where(
        small, (1 - a2 / 12 * (1 - a2 / 30 * (1 - a2 / 56 * (1 - a2 / 90)))) / 2, (1 - jnp.cos(safe)) / safe2
    )
    r = skew(vector)
    return jnp.eye(3, dtype=vector.dtype) + sine * r + versine * (r @ r)


def make_arm(screws: Float[Array, "n 6"], zero_position: Float[Array, " 3"], zero_rotation: Float[Array, "3 3"]) -> Arm:
    """An arm from screw axes (n, 6), (linear; angular), and the sensor's origin (3,) m and axes (3, 3) at q = 0."""
    screws = jnp.asarray(screws)
    return Arm(screws[:, :3], screws[:, 3:], jnp.asarray(zero_position), jnp.asarray(zero_rotation))


def exponentials(arm: Arm, q: Float[Array, " n"]) -> tuple[Float[Array, "n 3 3"], Float[Array, "n 3"]]:
    """One-joint transforms exp([S_j] q_j): rotations (n, 3, 3) and positions (n, 3).

    Rodrigues' formula as in the report; with s = 0 it reduces to the translation v q of a prismatic joint.
    The columns do not depend on one another: these are not the cumulative transforms (errata 8).
    """
    sin, versine = jnp.sin(q)[:, None], 2 * jnp.sin(q / 2)[:, None] ** 2  # 1 - cos q without cancellation
    v, S = arm.linear, skew(arm.angular)
    S_v = jnp.einsum("nij,nj->ni", S, v)
    rotation = jnp.eye(3, dtype=q.dtype)[None] + sin[..., None] * S + versine[..., None] * (S @ S)
    position = q[:, None] * v + versine * S_v + (q[:, None] - sin) * jnp.einsum("nij,nj->ni", S, S_v)
    return rotation, position


def product_of_exponentials(arm: Arm, q: Float[Array, " n"]) -> tuple[Float[Array, "n+1 3 3"], Float[Array, "n+1 3"]]:
    """Cumulative transforms T_j = exp([S_1] q_1) ... exp([S_j] q_j) for j = 0 ... n.

    Returns:
        rotations (n + 1, 3, 3) and positions (n + 1, 3) m; the first is the identity.
    """
    step_rotations, step_positions = exponentials(arm, q)
    rotations, positions = [jnp.eye(3, dtype=q.dtype)], [jnp.zeros(3, dtype=q.dtype)]
    for rotation, position in zip(step_rotations, step_positions, strict=True):
        positions.append(positions[-1] + rotations[-1] @ position)
        rotations.append(rotations[-1] @ rotation)
    return jnp.stack(rotations), jnp.stack(positions)


def sensor_pose(arm: Arm, q: Float[Array, " n"]) -> tuple[Float[Array, "3 3"], Float[Array, " 3"]]:
    """R_base_sensor (3, 3) and p_base_sensor (3,) m."""
    rotation, position, _ = _pose_and_space_jacobian(arm, q)
    return rotation, position


def sensor_motion(arm: Arm, q: Float[Array, " n"], dq: Float[Array, " n"], ddq: Float[Array, " n"]) -> Motion:
    """Pose, twist and acceleration of the sensor in O(n), equal to the Jacobian and Hessian form.

    With V_j the twist of link j and J_j the columns of the space Jacobian, d J_j / dt = ad(V_{j-1}) J_j, so the
    spatial acceleration is sum_j J_j ddq_j + ad(V_{j-1}) J_j dq_j (Featherstone 2008, section 2.9).

    Args:
        arm: the arm.
        q: (n,) rad, joint positions (m for prismatic joints, here and below).
        dq: (n,) rad/s, joint velocities.
        ddq: (n,) rad/s^2, joint accelerations.
    """
    rotation, position, jacobian = _pose_and_space_jacobian(arm, q)
    v, w = jacobian[:3].T, jacobian[3:].T
    v_dq, w_dq = v * dq[:, None], w * dq[:, None]
    v_before, w_before = jnp.cumsum(v_dq, 0) - v_dq, jnp.cumsum(w_dq, 0) - w_dq
    v_rate = jnp.cross(w_before, v_dq) + jnp.cross(v_before, w_dq)
    spatial_acceleration = (v * ddq[:, None] + v_rate).sum(0)
    angular_acceleration = (w * ddq[:, None] + jnp.cross(w_before, w_dq)).sum(0)
    angular_velocity = w_dq.sum(0)
    linear_velocity = v_dq.sum(0) + jnp.cross(angular_velocity, position)
    linear_acceleration = (
        spatial_acceleration + jnp.cross(angular_acceleration, position) + jnp.cross(angular_velocity, linear_velocity)
    )
    at_sensor = jacobian[:3] + jnp.cross(jacobian[3:].T, position).T  # columns of the space Jacobian: v + w x p
    return Motion(
        rotation,
        position,
        linear_velocity,
        angular_velocity,
        linear_acceleration,
        angular_acceleration,
        jnp.concatenate([at_sensor, jacobian[3:]]),
    )


def _pose_and_space_jacobian(arm: Arm, q: Array) -> tuple[Array, Array, Array]:
    rotations, positions = product_of_exponentials(arm, q)
    angular = jnp.einsum("nij,nj->ni", rotations[:-1], arm.angular)
    linear = jnp.einsum("nij,nj->ni", rotations[:-1], arm.linear) + jnp.cross(positions[:-1], angular)
    sensor_rotation = rotations[-1] @ arm.zero_rotation
    sensor_position = rotations[-1] @ arm.zero_position + positions[-1]
    return sensor_rotation, sensor_position, jnp.concatenate([linear, angular], -1).T
