"""Rigid bodies, and their combination in a common frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ftbias_jax.setup.fields import read_only
from ftbias_jax.setup.types import ToolSetup
from ftbias_jax.types import Array


class RigidBody(NamedTuple):
    """A rigid body in some frame."""

    mass: float
    """kg."""
    center: Array
    """(3,) m, centre of mass."""
    inertia: Array
    """(3, 3) kg m^2 about the centre of mass, axes of the frame."""

    def seen_from(self, rotation: Array, position: Array) -> RigidBody:
        """Express the body in a frame at ``position`` (3,) m whose axes are the columns of ``rotation`` (3, 3)."""
        return RigidBody(self.mass, rotation.T @ (self.center - position), rotation.T @ self.inertia @ rotation)

    def as_tool(self) -> ToolSetup:
        """Return the body as the tool of a setup, if its frame is the sensor's."""
        return ToolSetup(float(self.mass), read_only(self.center), read_only(self.inertia[np.triu_indices(3)]))


def joined(one: RigidBody, other: RigidBody, sign: float = 1.0) -> RigidBody:
    """Combine two bodies into one; with the sign -1, subtract the other from the one (parallel axis theorem)."""
    mass = one.mass + sign * other.mass
    center = (one.mass * one.center + sign * other.mass * other.center) / mass
    inertia = np.zeros((3, 3))
    for body, weight in ((one, 1.0), (other, sign)):
        arm = body.center - center
        inertia += weight * (body.inertia + body.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm)))
    return RigidBody(mass, center, inertia)
