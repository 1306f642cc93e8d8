"""Measurement noise of the wrench that the motion of the joints causes."""

from typing import Any, NamedTuple, Self

import numpy as np

from ftbias_jax.types import Array


class MotionNoise(NamedTuple):
    """Measurement noise variance that the speeds of n joints add to k channels."""

    per_speed: Array
    """(n, k), or (1, k) for all joints, N^2/(rad/s)^2, Nm^2/(rad/s)^2: variance per ``effective_speed_squared``."""
    speed: float | Array | None = None
    """rad/s: ``most`` of ``effective_speed_squared``; None = variance grows with the square of the speed throughout."""

    def variance(self, velocity: Array) -> Array:
        """Variance (..., k), N^2 and Nm^2, at the joint velocities (..., n) rad/s."""
        effective = effective_speed_squared(velocity, self.speed)
        if len(self.per_speed) == 1:
            effective = effective.sum(-1, keepdims=True)
        return effective @ self.per_speed

    def as_numbers(self) -> Self:
        """The same noise model with NumPy arrays in double precision."""
        speed = None if self.speed is None else float(self.speed)
        return self._replace(per_speed=np.asarray(self.per_speed, float), speed=speed)


def effective_speed_squared(velocity: Any, most: Any) -> Any:
    """dq^2 / sqrt(1 + (dq / most)^2), (rad/s)^2: vibration of real arms grows with dq^2, above some speed with |dq|.

    On recorded logs of three robots this form predicts the scatter of held-out segments at least as well as one that
    saturates, and its error is smaller where ``most`` is wrong.

    Args:
        velocity: joint velocities, rad/s.
        most: rad/s, the speed above which it grows with |dq|; None = never.
    """
    return velocity**2 if most is None else velocity**2 / (1 + velocity**2 / most**2) ** 0.5
