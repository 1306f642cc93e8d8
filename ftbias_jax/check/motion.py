"""Motion of the sensor over many bins, in NumPy: of an arm, or of a body whose pose was recorded."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ftbias_jax.setup.rotations import skew
from ftbias_jax.setup.types import RobotSetup, SensorSetup
from ftbias_jax.types import Array

INERTIA = np.zeros((3, 3, 6))
"""(3, 3, 6) map from Ixx Ixy Ixz Iyy Iyz Izz to the entries (i, j) of the inertia matrix."""
INERTIA[[0, 0, 0, 1, 1, 1, 2, 2, 2], [0, 1, 2] * 3, [0, 1, 2, 1, 3, 4, 2, 4, 5]] = 1


class SensorMotion(NamedTuple):
    """Motion of the sensor over N bins."""

    rotation: Float[Array, "N 3 3"]
    """R_base_sensor."""
    acceleration: Float[Array, "N 3"]
    """m/s^2, acceleration of the sensor's origin, base frame."""
    velocity: Float[Array, "N 3"]
    """rad/s, angular velocity, base frame."""
    turning: Float[Array, "N 3"]
    """rad/s^2, angular acceleration, base frame."""
    position: Float[Array, "N 3"]
    """m, position of the sensor's origin, base frame."""


def arm_motion(robot: RobotSetup, sensor: SensorSetup, q: Array, dq: Array, ddq: Array) -> SensorMotion:
    """Motion of a sensor on an arm, by the recursion of ``model.kinematics.screws.sensor_motion``.

    q, dq and ddq (N, n) are in rad (m), rad/s (m/s) and rad/s^2 (m/s^2).
    """
    count = len(q)
    R, p = np.broadcast_to(np.eye(3), (count, 3, 3)), np.zeros((count, 3))
    v, w, dv, dw = (np.zeros((count, 3)) for _ in range(4))  # spatial twist and its rate, about the base's origin
    for screw, x, dx, ddx in zip(robot.screws, q.T, dq.T, ddq.T, strict=True):
        angular = R @ screw[3:]
        linear = R @ screw[:3] + np.cross(p, angular)
        dv = dv + linear * ddx[:, None] + (np.cross(w, linear) + np.cross(v, angular)) * dx[:, None]
        dw = dw + angular * ddx[:, None] + np.cross(w, angular) * dx[:, None]
        v, w = v + linear * dx[:, None], w + angular * dx[:, None]
        S = skew(screw[3:])
        sin, versine = np.sin(x)[:, None], 2 * np.sin(x / 2)[:, None] ** 2
        turn = np.eye(3) + sin[..., None] * S + versine[..., None] * (S @ S)
        step = x[:, None] * screw[:3] + versine * (S @ screw[:3]) + (x[:, None] - sin) * (S @ S @ screw[:3])
        p = p + np.einsum("nij,nj->ni", R, step)
        R = R @ turn
    position = p + R @ (robot.flange_translation + robot.flange_rotation @ sensor.translation)
    velocity = v + np.cross(w, position)
    acceleration = dv + np.cross(dw, position) + np.cross(w, velocity)
    return SensorMotion(R @ (robot.flange_rotation @ sensor.rotation), acceleration, w, dw, position)


def body_motion(
    sensor: SensorSetup, lever: Array, q: Array, dq: Array, ddq: Array, *, in_body: bool = False
) -> SensorMotion:
    """Motion of a sensor on a body whose pose was recorded (``model.kinematics.recorded_pose``).

    The lever (3,) m is from the body's origin to the sensor's, body frame; q (N, 4 or 7) is the quaternion w, x, y, z
    of the body in the base, and its position in m, along the body's axes if ``in_body``; dq and ddq are the rates.
    """
    length = np.linalg.norm(q[:, :4], axis=1)
    n2 = (length**2)[:, None]
    w0, u = q[:, :1], q[:, 1:4]
    R = np.eye(3) + 2 / n2[..., None] * (w0[..., None] * skew(u) + skew(u) @ skew(u))

    def rate(x: Array) -> Array:
        return 2 / n2 * (-u * x[:, :1] + w0 * x[:, 1:4] + np.cross(u, x[:, 1:4]))

    w = rate(dq)
    dw = rate(ddq) - 2 * (q[:, :4] * dq[:, :4]).sum(1, keepdims=True) / n2 * w
    p, v, a = (x[:, 4:] if x.shape[1] > 4 else np.zeros((len(x), 3)) for x in (q, dq, ddq))
    if in_body:
        p, v, a = (np.einsum("nij,nj->ni", R, x) for x in (p, v, a))
        a = a + 2 * np.cross(w, v) + np.cross(dw, p) + np.cross(w, np.cross(w, p))
    arm = R @ lever
    a = a + np.cross(dw, arm) + np.cross(w, np.cross(w, arm))
    return SensorMotion(R @ sensor.rotation, a, w, dw, p + arm)


def data_matrices(motion: SensorMotion, gravity: Array, specific_force: Array | None = None) -> Float[Array, "N 6 10"]:
    """Data matrix D of every bin, with W = D theta (``model.wrench.tool_wrench.data_matrix``).

    Gravity is (3,) m/s^2 in the base frame; an accelerometer's specific force (N, 3) m/s^2 is in the sensor frame.
    """
    f = in_sensor(motion, motion.acceleration - gravity) if specific_force is None else specific_force
    w, a = in_sensor(motion, motion.velocity), in_sensor(motion, motion.turning)
    D = np.zeros((len(f), 6, 10))
    D[:, :3, 0] = f
    D[:, :3, 1:4] = skew(w) @ skew(w) + skew(a)
    D[:, 3:, 1:4] = -skew(f)
    of_inertia = (np.einsum("nj,ijk->nik", x, INERTIA) for x in (a, w))
    D[:, 3:, 4:] = next(of_inertia) + skew(w) @ next(of_inertia)
    return D


def in_sensor(motion: SensorMotion, vectors: Array) -> Float[Array, "N 3"]:
    """Transform vectors (N, 3) from the base frame to the sensor frame."""
    return np.einsum("nji,nj->ni", motion.rotation, vectors)
