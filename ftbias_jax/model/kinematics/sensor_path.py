"""How the sensor moves over a log: its pose, velocities and accelerations, whatever carries it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import jax.numpy as jnp
from jax import Array

from ftbias_jax.model.kinematics.arm_batch import ArmMotion
from ftbias_jax.model.kinematics.recorded_pose import FreeBody, motions_of
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
    """Where the sensor is and how it moves, from joints (T, n) rad, or entries of a recorded pose, and their rates.

    A motion that was worked out before is taken as it is; its joints may stand elsewhere than ``q`` says.
    """
    moving = motions_of(carrier, q.T, dq.T, ddq.T) if motion is None else motion
    vectors = (
        moving.sensor_position,
        moving.velocity,
        moving.angular_velocity,
        moving.acceleration,
        moving.angular_acceleration,
    )
    return SensorPath(jnp.moveaxis(moving.sensor_rotation, 2, 0), *(vector.T for vector in vectors))
