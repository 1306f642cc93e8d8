"""How the sensor moves over a log: its pose, velocities and accelerations, whatever carries it."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ftbias_jax.model.kinematics.arm_batch import ArmMotion, arm_motion
from ftbias_jax.model.kinematics.recorded_pose import FreeBody, body_motion
from ftbias_jax.model.kinematics.screws import Arm

if TYPE_CHECKING:
    from jaxtyping import Float


class SensorPath(NamedTuple):
    """The sensor's frame at every sample, in the base frame."""

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


def sensor_path(
    carrier: Arm | FreeBody,
    q: Float[Array, "T n"],
    dq: Float[Array, "T n"],
    ddq: Float[Array, "T n"],
    motion: ArmMotion | None = None,
) -> SensorPath:
    """Where the sensor is and how it moves.

    Args:
        carrier: the arm with the sensor mounted, or the body whose pose is recorded.
        q: (T, n) rad.
        dq: (T, n) rad/s.
        ddq: (T, n) rad/s^2.
        motion: of the arm, if it was worked out before; its joints may stand elsewhere than ``q`` says.
    """
    if isinstance(carrier, FreeBody):
        body = jax.vmap(partial(body_motion, carrier))(q, dq, ddq)
        return SensorPath(
            body.R_base_sensor,
            body.p_base_sensor,
            body.linear_velocity,
            body.angular_velocity,
            body.linear_acceleration,
            body.angular_acceleration,
        )
    motion = arm_motion(carrier, q.T, dq.T, ddq.T) if motion is None else motion
    rotation = jnp.moveaxis(motion.sensor_rotation, 2, 0)
    vectors = (
        motion.sensor_position,
        _velocity(carrier, motion, dq.T),
        motion.angular_velocity,
        motion.acceleration,
        motion.angular_acceleration,
    )
    return SensorPath(rotation, *(vector.T for vector in vectors))


def _velocity(arm: Arm, motion: ArmMotion, dq: Float[Array, "n T"]) -> Float[Array, "3 T"]:
    """Velocity of the sensor's origin: every joint turns or shifts it about the axis where the joint now is."""
    R, p = motion.link_rotation[:, :, :-1], motion.link_position[:, :-1]
    axis = jnp.einsum("ijnt,nj->int", R, arm.angular)
    shift = jnp.einsum("ijnt,nj->int", R, arm.linear)
    lever = motion.sensor_position[:, None] - p
    return ((shift + jnp.cross(axis, lever, axis=0)) * dq[None]).sum(1)
