"""The wrench of a known tool, W = D theta, and how its uncertainty propagates to the measurement.

Sign (report): W is the force and torque the sensor exerts on the tool, sensor frame, torque about the sensor origin.
The sensor reads W = D theta - b + noise, so the bias b is *minus* the offset people usually speak of, and the
corrected wrench is reading + b (errata 9).
theta = (m, m c, Ixx, Ixy, Ixz, Iyy, Iyz, Izz): mass, first moment, inertia about the sensor origin, sensor axes.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ftbias_jax.model.kinematics.recorded_pose import FreeBody, motion_of
from ftbias_jax.model.kinematics.screws import Arm, Motion, skew

_DEAD_ROWS = {0: (3, 4, 5), 1: (3,), 2: (4,), 3: (5,)} | dict.fromkeys(range(4, 10), (0, 1, 2))

LIVE_ENTRIES: np.ndarray = np.array(
    [6 * column + row for column in range(10) for row in range(6) if row not in _DEAD_ROWS[column]]
)
"""(36,) indices of the entries of vec(D), column-major, that are not always zero."""


class Model(NamedTuple):
    """Nominal model of robot and tool that the setup states."""

    arm: Arm
    """The robot with the sensor frame mounted."""
    gravity: Float[Array, " 3"]
    """(3,) m/s^2, base frame."""
    theta: Float[Array, " 10"]
    """(10,) inertial parameters of the tool, as above."""


def vec(matrix: Float[Array, "r c"]) -> Float[Array, " r*c"]:
    """Stack the columns: vec(X Y Z) = (Z^T kron X) vec(Y) holds for this order, not for a row-major reshape."""
    return matrix.T.reshape(-1)


def tool_parameters(
    mass: Float[Array, ""], center_of_mass: Float[Array, " 3"], inertia: Float[Array, " 6"]
) -> Float[Array, " 10"]:
    """Inertial parameters theta (10,) from what a data sheet states.

    Args:
        mass: () kg.
        center_of_mass: (3,) m, sensor frame.
        inertia: (6,) kg m^2, Ixx Ixy Ixz Iyy Iyz Izz about the centre of mass, sensor axes (matrix elements).
    """
    x, y, z = center_of_mass
    steiner = mass * jnp.stack([y * y + z * z, -x * y, -x * z, x * x + z * z, -y * z, x * x + y * y])
    return jnp.concatenate([jnp.stack([mass, mass * x, mass * y, mass * z]), inertia + steiner])


def data_matrix(
    specific_force: Float[Array, " 3"], angular_velocity: Float[Array, " 3"], angular_acceleration: Float[Array, " 3"]
) -> Float[Array, "6 10"]:
    """Data matrix D (6, 10) with W = D theta (report, section 3), with gravity (errata 2) and frames (errata 3).

    Args:
        specific_force: (3,) m/s^2, a - g of the sensor origin, sensor frame.
        angular_velocity: (3,) rad/s, sensor frame.
        angular_acceleration: (3,) rad/s^2, sensor frame.
    """
    wx, wy, wz = angular_velocity
    ax, ay, az = angular_acceleration
    turning = skew(angular_velocity) @ skew(angular_velocity) + skew(angular_acceleration)
    inertia_columns = jnp.stack(
        [
            jnp.stack([ax, ay - wx * wz, az + wx * wy, -wy * wz, wy**2 - wz**2, wy * wz]),
            jnp.stack([wx * wz, ax + wy * wz, wz**2 - wx**2, ay, az - wx * wy, -wx * wz]),
            jnp.stack([-wx * wy, wx**2 - wy**2, ax - wy * wz, wx * wy, ay + wx * wz, az]),
        ]
    )
    force_rows = jnp.concatenate([specific_force[:, None], turning, jnp.zeros_like(inertia_columns)], 1)
    no_mass = jnp.zeros_like(specific_force)[:, None]
    torque_rows = jnp.concatenate([no_mass, -skew(specific_force), inertia_columns], 1)
    return jnp.concatenate([force_rows, torque_rows])


def reduced_observation_matrix(theta: Float[Array, " 10"]) -> Float[Array, "6 36"]:
    """The columns (6, 36) of B = theta^T kron I_6, W = B vec(D), that multiply entries of D which are not always zero.

    They have the order of LIVE_ENTRIES and the units of theta (10,): kg, kg m, kg m^2.
    """
    return jnp.kron(theta[None, :], jnp.eye(6, dtype=theta.dtype))[:, LIVE_ENTRIES]


def measurement_covariance(
    theta: Float[Array, " 10"], data_variance: Float[Array, " 36"] | None, wrench_variance: Float[Array, " 6"]
) -> Float[Array, "6 6"]:
    """R = B Sigma_D B^T + Sigma_W (6, 6), the noise of y = D theta - W; n_D is in it once (errata 6).

    Args:
        theta: (10,) inertial parameters.
        data_variance: (36,) diagonal of Sigma_D, live entries of vec(D), or None for zeros.
        wrench_variance: (6,) diagonal of Sigma_W, N^2 and Nm^2.
    """
    if data_variance is None:
        return jnp.diag(wrench_variance)
    B = reduced_observation_matrix(theta)
    return (B * data_variance[None]) @ B.T + jnp.diag(wrench_variance)


def joint_sensitivity(
    theta: Float[Array, " 10"],
    R_base_sensor: Float[Array, "3 3"],
    jacobian: Float[Array, "6 n"],
    gravity: Float[Array, " 3"],
) -> tuple[Float[Array, "6 n"], Float[Array, "6 n"]]:
    """Derivatives of the predicted wrench W = D theta with respect to joint positions and accelerations.

    The acceleration part is exact; the position part includes the rotation of gravity and neglects terms of the size of
    the motion's own acceleration, so it is exact at rest. Velocity enters only through products of rates and is
    neglected: with a filter's 1e-3 rad/s it is thousands of times smaller than the acceleration part.

    Args:
        theta: (10,) inertial parameters.
        R_base_sensor: (3, 3).
        jacobian: (6, n) sensor Jacobian, base frame.
        gravity: (3,) m/s^2, base.

    Returns:
        dW/dq (6, n) in N/rad, Nm/rad and dW/dddq (6, n) in N s^2/rad, Nm s^2/rad; sensor frame.
    """
    linear, angular = R_base_sensor.T @ jacobian[:3], R_base_sensor.T @ jacobian[3:]
    gravity_in_sensor = R_base_sensor.T @ gravity
    falling = jnp.cross(angular.T, gravity_in_sensor).T
    return _inertial_wrench(theta, falling, jnp.zeros_like(angular)), _inertial_wrench(theta, linear, angular)


def covariance_of_joints(sensitivity: tuple[Array, Array], covariance: Float[Array, "n 3 3"]) -> Float[Array, "6 6"]:
    """The diagonal of sum_j G_j P_j G_j^T as a matrix (6, 6), with G_j = (dW/dq_j, 0, dW/dddq_j).

    Args:
        sensitivity: dW/dq and dW/dddq (6, n) N, Nm per rad and rad/s^2, of ``joint_sensitivity``.
        covariance: (n, 3, 3) of the joint filter.
    """
    G, P = jnp.stack(sensitivity, -1), covariance[:, ::2, ::2]
    return jnp.diag(jnp.einsum("ind,nde,ine->i", G, P, G))


def _inertial_wrench(theta: Array, linear: Array, angular: Array) -> Array:
    """D theta at zero angular velocity, for columns (3, n) of linear and angular acceleration."""
    mass, first_moment = theta[0], theta[1:4]
    xx, xy, xz, yy, yz, zz = theta[4:]
    inertia = jnp.stack([jnp.stack([xx, xy, xz]), jnp.stack([xy, yy, yz]), jnp.stack([xz, yz, zz])])
    force = mass * linear - skew(first_moment) @ angular
    return jnp.concatenate([force, skew(first_moment) @ linear + inertia @ angular])


class DataNoise(NamedTuple):
    """Standard deviations of the sensor's motion; each (3,), sensor axes."""

    linear_acceleration: Array
    """m/s^2."""
    angular_acceleration: Array
    """rad/s^2."""
    angular_velocity: Array
    """rad/s."""
    gravity_direction: Array
    """rad."""


def data_variance(noise: DataNoise, gravity: Array) -> Array:
    """Diagonal (36,) of Sigma_D over the live entries of vec(D) (``tool_wrench.LIVE_ENTRIES``); gravity in m/s^2."""
    x, y, z = noise.linear_acceleration**2 + (gravity @ gravity) * noise.gravity_direction**2
    ax, ay, az = noise.angular_acceleration**2
    rate = noise.angular_velocity**2
    xx, yy, zz = 2 * rate**2
    xy, xz, yz = rate[0] * rate[1], rate[0] * rate[2], rate[1] * rate[2]
    zero = jnp.zeros_like(x)
    rows = [
        [x, yy + zz, xy + az, xz + ay, *[zero] * 6],
        [y, xy + az, xx + zz, yz + ax, *[zero] * 6],
        [z, xz + ay, yz + ax, xx + yy, *[zero] * 6],
        [zero, zero, z, y, ax, ay + xz, az + xy, yz, yy + zz, yz],
        [zero, z, zero, x, xz, ax + yz, zz + xx, ay, az + xy, xz],
        [zero, y, x, zero, xy, xx + yy, ax + yz, xy, ay + xz, az],
    ]
    return vec(jnp.stack([jnp.stack(row) for row in rows]))[LIVE_ENTRIES]


def unbias(
    wrench: Float[Array, " 6"], bias_and_drift: Float[Array, " 12"], elapsed: Float[Array, ""]
) -> Float[Array, " 6"]:
    """Corrected wrench, biased + [I, I dT] x (report, last equation).

    Args:
        wrench: (6,) N, Nm, as read.
        bias_and_drift: (12,) filter mean.
        elapsed: () s since that mean was computed.
    """
    return wrench + bias_and_drift[:6] + elapsed * bias_and_drift[6:]


def motion_and_wrench(
    arm: Arm | FreeBody,
    gravity: Float[Array, " 3"],
    theta: Float[Array, " 10"],
    q: Float[Array, " n"],
    dq: Float[Array, " n"],
    ddq: Float[Array, " n"],
) -> tuple[Motion, Array]:
    """Motion of the sensor, and the wrench W = D theta that it exerts on the tool.

    Args:
        arm: kinematics of the robot, or of a recorded pose.
        gravity: (3,) m/s^2, base frame.
        theta: (10,) inertial parameters of the tool, as in ``Model``.
        q: (n,) joint positions, rad.
        dq: (n,) joint velocities, rad/s.
        ddq: (n,) joint accelerations, rad/s^2.

    Returns:
        the motion, base frame, and (6,) N, Nm, sensor frame.
    """
    motion = motion_of(arm, q, dq, ddq)
    R_sensor_base = motion.R_base_sensor.T
    D = data_matrix(
        R_sensor_base @ (motion.linear_acceleration - gravity),
        R_sensor_base @ motion.angular_velocity,
        R_sensor_base @ motion.angular_acceleration,
    )
    return motion, D @ theta
