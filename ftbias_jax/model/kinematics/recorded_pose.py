"""Kinematics of a sensor whose pose is recorded, instead of the joints of an arm that carries it.

The joint filter estimates the four entries of the quaternion and the three of the position, each as if it were a joint.
A quaternion of any length q = n u represents the rotation of u = q/n, so the filter need not enforce unit length, no
orientation is singular, and the angular velocity is linear in the rates of the entries:

    u' u* = w/2,  vec(q' q*) = n^2 w/2,  vec(q'' q*) = n n' w + n^2 w'/2

with * the conjugate, w the angular velocity and w' the angular acceleration, both in base coordinates.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ftbias_jax.model.kinematics.arm_batch import ArmMotion, arm_motion
from ftbias_jax.model.kinematics.screws import Arm, Motion, sensor_motion, skew


class FreeBody(NamedTuple):
    """A body whose pose is recorded, with the sensor mounted on it."""

    zero_position: Float[Array, " 3"]
    """(3,) m, sensor origin in the body's frame."""
    zero_rotation: Float[Array, "3 3"]
    """(3, 3) sensor axes in the body's frame: R v_sensor = v_body."""


def motion_of(
    carrier: Arm | FreeBody, q: Float[Array, " n"], dq: Float[Array, " n"], ddq: Float[Array, " n"]
) -> Motion:
    """Motion of the sensor, carried by an arm (``screws.sensor_motion``) or recorded (``body_motion``)."""
    return body_motion(carrier, q, dq, ddq) if isinstance(carrier, FreeBody) else sensor_motion(carrier, q, dq, ddq)


def body_motion(body: FreeBody, q: Float[Array, " k"], dq: Float[Array, " k"], ddq: Float[Array, " k"]) -> Motion:
    """Motion of the sensor from the body's pose and its rates.

    The entries q (7,) are the quaternion (w, x, y, z) of the body in the base, of any length but zero, and its position
    in m; or (4,) without position, whose acceleration is then zero. The Jacobian has one column per entry.
    """
    n2 = q[:4] @ q[:4]
    w, v = q[0], q[1:4]
    rotation = jnp.eye(3, dtype=q.dtype) + 2 / n2 * (w * skew(v) + skew(v) @ skew(v))
    rate = 2 / n2 * jnp.concatenate([-v[:, None], w * jnp.eye(3, dtype=q.dtype) + skew(v)], 1)
    angular_velocity = rate @ dq[:4]
    angular_acceleration = rate @ ddq[:4] - 2 * (q[:4] @ dq[:4]) / n2 * angular_velocity
    lever = rotation @ body.zero_position
    position, velocity, acceleration = (x[4:] if x.shape[0] > 4 else jnp.zeros(3, q.dtype) for x in (q, dq, ddq))
    linear_velocity = velocity + jnp.cross(angular_velocity, lever)
    turning = jnp.cross(angular_velocity, linear_velocity - velocity)
    linear = jnp.concatenate([-skew(lever) @ rate, jnp.eye(3, q.shape[0] - 4, dtype=q.dtype)], 1)
    angular = jnp.concatenate([rate, jnp.zeros((3, q.shape[0] - 4), q.dtype)], 1)
    return Motion(
        rotation @ body.zero_rotation,
        position + lever,
        linear_velocity,
        angular_velocity,
        acceleration + jnp.cross(angular_acceleration, lever) + turning,
        angular_acceleration,
        jnp.concatenate([linear, angular]),
    )


def body_motions(
    body: FreeBody, q: Float[Array, "k T"], dq: Float[Array, "k T"], ddq: Float[Array, "k T"]
) -> ArmMotion:
    """Motion at pose entries (k, T), represented as an arm of one link: link 0 is the world, link 1 the body."""
    time_last = partial(jax.vmap, in_axes=1, out_axes=-1)
    sensor = time_last(lambda *state: body_motion(body, *state))(q, dq, ddq)
    bare = FreeBody(jnp.zeros_like(body.zero_position), jnp.eye(3, dtype=q.dtype))
    link = time_last(lambda *state: body_motion(bare, *state))(q, dq, ddq)
    world = jnp.broadcast_to(jnp.eye(3, dtype=q.dtype)[:, :, None], link.R_base_sensor.shape)
    return ArmMotion(
        jnp.stack([world, link.R_base_sensor], 2),
        jnp.stack([jnp.zeros_like(link.p_base_sensor), link.p_base_sensor], 1),
        sensor.R_base_sensor,
        sensor.p_base_sensor,
        sensor.linear_acceleration,
        sensor.angular_velocity,
        sensor.angular_acceleration,
        sensor.linear_velocity,
    )


def motions_of(
    carrier: Arm | FreeBody, q: Float[Array, "n T"], dq: Float[Array, "n T"], ddq: Float[Array, "n T"]
) -> ArmMotion:
    """The motion at many samples, of an arm (``arm_batch.arm_motion``) or of a recorded body."""
    return body_motions(carrier, q, dq, ddq) if isinstance(carrier, FreeBody) else arm_motion(carrier, q, dq, ddq)


def speeds_of(carrier: Any, rates: Any) -> Any:
    """Speeds (..., s) rad/s with which noise may grow, NumPy or JAX: of each joint, or of a recorded body's rotation.

    Args:
        carrier: an Arm or a FreeBody.
        rates: (..., n) rates of the joints, or of the entries of a pose, whose quaternion has unit length and changes
            by half of the angle.
    """
    if not isinstance(carrier, FreeBody):
        return rates
    smallest = np.finfo(rates.dtype).tiny  # The root is not differentiable at rest.
    return 2 * ((rates[..., :4] ** 2).sum(-1) + smallest)[..., None] ** 0.5


class SensorPath(NamedTuple):
    """Pose and motion of the sensor's frame at every sample, in the base frame."""

    rotation: Float[Array, "T 3 3"]
    """(T, 3, 3) R_base_sensor."""
    position: Float[Array, "T 3"]
    """(T, 3) m."""
    velocity: Float[Array, "T 3"]
    """(T, 3) m/s, of the sensor's origin."""
    angular_velocity: Float[Array, "T 3"]
    """(T, 3) rad/s."""
    acceleration: Float[Array, "T 3"]
    """(T, 3) m/s^2, of the sensor's origin, without gravity."""
    angular_acceleration: Float[Array, "T 3"]
    """(T, 3) rad/s^2."""


def path_of(motion: ArmMotion) -> SensorPath:
    """Pose and motion of the sensor, sample by sample."""
    vectors = motion.sensor_position, motion.velocity, motion.angular_velocity
    rates = motion.acceleration, motion.angular_acceleration
    return SensorPath(jnp.moveaxis(motion.sensor_rotation, 2, 0), *(vector.T for vector in (*vectors, *rates)))
