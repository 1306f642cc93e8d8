"""Motion of an arm at many samples together, in sensor axes: recursion over the joints from the sensor to the base.

Every joint has a frame whose z axis is the joint's axis, so a rotation of the joint mixes two columns of a rotation
matrix and leaves the third, the joint's column of the Jacobian. A fixed rotation Rz(a) Rx(b) Rz(c) leads from the frame
of a joint to that of the previous joint; its rotations about z add to the angles of the two joints, so only that by b
remains. This takes half the arithmetic of a product of exponentials (arm_batch.py), and equals it to round-off.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from ftbias_jax.model.kinematics.arm_batch import Columns, Moving, Twist
from ftbias_jax.model.kinematics.screws import Arm
from ftbias_jax.runtime.lanes import Rows, Vector, cross, scale, times, total
from ftbias_jax.runtime.trigonometry import sine_and_versine


class Chain(NamedTuple):
    """Constants of an arm with n joints, ordered from the base."""

    turning: Float[Array, " n"]
    """(n,) 1 for a revolute joint, 0 for a prismatic one."""
    slide: Float[Array, " n"]
    """(n,) m along the axis per unit of q."""
    offset: Float[Array, " n"]
    """(n,) rad: the angle at q = 0."""
    tilt: Float[Array, "n 2"]
    """(n, 2) cosine and sine of b, the angle between the axes of a joint and of the previous joint."""
    step: Float[Array, "n 3"]
    """(n, 3) m from the frame of a joint to that of the previous joint, in the axes of the latter."""
    last_axes: Float[Array, "3 3"]
    """(3, 3) x, y and z axes of the last joint's frame, one per row, sensor axes."""
    last_position: Float[Array, " 3"]
    """(3,) m, origin of the last joint's frame relative to the sensor, sensor axes."""
    base: Float[Array, "3 3"]
    """(3, 3) axes of the base in the frame that remains before the first joint."""


class Walk(NamedTuple):
    """State of the recursion from the sensor to the base, sensor axes; entries (C,)."""

    axes: Rows
    """x, y and z axes of the joint's frame."""
    position: Vector
    """m, origin of the joint's frame."""
    moving: Moving
    """Motion of the sensor by the joints already passed; the acceleration is that of the body's point at the sensor."""


class Turns(NamedTuple):
    """Sine and cosine of all joints' angles, (n, C) each."""

    sin: Array
    cos: Array


def chain_of(arm: Arm) -> Chain:
    """The frames of an arm's joints, whose screws may have any pitch."""
    v, s = arm.linear, arm.angular
    turns = (s**2).sum(1, keepdims=True) > 0
    z = _unit(jnp.where(turns, s, v))
    origin = jnp.cross(s, v)  # This point of the axis is the nearest to the base's origin.
    frames = _frames(z)
    before = jnp.concatenate([jnp.eye(3, dtype=v.dtype)[None], frames[:-1]])
    C = jnp.einsum("nki,nkj->nij", frames, before)
    a = jnp.arctan2(C[:, 0, 2], -C[:, 1, 2])
    cos, sin = jnp.cos(a)[:, None], jnp.sin(a)[:, None]
    first, second = cos * C[:, 0] + sin * C[:, 1], cos * C[:, 1] - sin * C[:, 0]  # of Rz(-a) C = Rx(b) Rz(c)
    c = jnp.arctan2(-first[:, 1], first[:, 0])
    tilt = jnp.stack([C[:, 2, 2], -second[:, 2]], 1)
    x, y, depth = jnp.einsum("nki,nk->in", frames, jnp.concatenate([origin[:1], origin[:-1]]) - origin)
    x, y = cos[:, 0] * x + sin[:, 0] * y, cos[:, 0] * y - sin[:, 0] * x
    step = jnp.stack([x, tilt[:, 0] * y + tilt[:, 1] * depth, tilt[:, 0] * depth - tilt[:, 1] * y], 1)
    cos, sin, zero = jnp.cos(c[0]), jnp.sin(c[0]), jnp.zeros_like(c[0])
    return Chain(
        turns[:, 0].astype(v.dtype),
        (v * z).sum(1),
        a + jnp.concatenate([c[1:], jnp.zeros_like(c[:1])]),
        tilt,
        step,
        frames[-1].T @ arm.zero_rotation,
        arm.zero_rotation.T @ (origin[-1] - arm.zero_position),
        jnp.stack([jnp.stack([cos, -sin, zero]), jnp.stack([sin, cos, zero]), jnp.stack([zero, zero, zero + 1])]),
    )


def _unit(v: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    """Unit vectors in the direction of vectors; the z axis for a zero vector."""
    square = (v**2).sum(1, keepdims=True)
    there = square > 0
    return jnp.where(there, v / jnp.sqrt(jnp.where(there, square, 1)), jnp.eye(3, dtype=v.dtype)[2])


def _frames(z: Float[Array, "n 3"]) -> Float[Array, "n 3 3"]:
    """Rotations whose third columns are the unit vectors z (Duff et al. 2017)."""
    x, y, up = z.T
    sign = jnp.where(up < 0, -1, 1).astype(z.dtype)
    a = -1 / (sign + up)
    b = x * y * a
    first = jnp.stack([1 + sign * x * x * a, sign * b, -sign * x], 1)
    second = jnp.stack([b, sign + y * y * a, -y], 1)
    return jnp.stack([first, second, z], 2)


def turns_of(chain: Chain, q: Float[Array, "n C"]) -> Turns:
    """Sine and cosine of the joints' angles in the frames of the chain."""
    sin, versine = sine_and_versine(chain.offset[:, None] - chain.turning[:, None] * q)
    return Turns(sin, 1 - versine)


def seen_by_sensor(chain: Chain, turns: Turns, vector: Vector) -> Vector:
    """A constant vector of the base frame, entries (), such as gravity, in sensor axes: entries (C,)."""

    def joint(seen: Vector, own: tuple[Array, Turns]) -> tuple[Vector, None]:
        (x, y, z), ((cos_b, sin_b), (sin, cos)) = seen, own
        y, z = cos_b * y - sin_b * z, sin_b * y + cos_b * z
        return [cos * x - sin * y, sin * x + cos * y, z], None

    zero = jnp.zeros_like(turns.sin[0])
    start = [zero + x for x in times([list(row) for row in chain.base], vector)]
    seen: Vector = jax.lax.scan(joint, start, (chain.tilt, turns))[0]
    return times([list(column) for column in chain.last_axes.T], seen)


def at_last_joint(chain: Chain, zero: Float[Array, " C"]) -> Walk:
    """Initial state of the recursion, at the last joint."""
    rest = Twist([zero] * 3, [zero] * 3)
    axes = [[zero + x for x in axis] for axis in chain.last_axes]
    return Walk(axes, [zero + x for x in chain.last_position], Moving(rest, rest))


def column_of(chain: Chain, j: Array, z: Vector, position: Vector) -> Columns:
    """Column of the sensor's Jacobian for joint j, whose axis is z: linear and angular, entries (C,)."""
    axis = scale(chain.turning[j], z)
    return Columns(total(cross(position, axis), scale(chain.slide[j], z)), axis)


def moved_by(column: Columns, dq: Array, ddq: Array, moving: Moving) -> Moving:
    """Motion with one more joint; the joints already passed change its column at the rate -(w x V + v x W, w x W)."""
    (v, w), (v_rate, w_rate) = moving
    V, W = column
    U, u = scale(dq, V), scale(dq, W)
    v_rate = total(v_rate, scale(ddq, V), cross(U, w), cross(u, v))
    w_rate = total(w_rate, scale(ddq, W), cross(u, w))
    return Moving(Twist(total(v, U), total(w, u)), Twist(v_rate, w_rate))


def joint_before(chain: Chain, j: Array, q: Array, turns: Turns, axes: Rows, position: Vector) -> tuple[Rows, Vector]:
    """Axes and origin of the frame before joint j, whose q (C,) and turns (n, C) are given."""
    x, y, z = axes
    sin, cos = turns.sin[j], turns.cos[j]
    cos_b, sin_b = chain.tilt[j]
    x, y = total(scale(cos, x), scale(sin, y)), total(scale(cos, y), scale(-sin, x))
    y, up = total(scale(cos_b, y), scale(sin_b, z)), total(scale(cos_b, z), scale(-sin_b, y))
    moved = [scale(by, axis) for by, axis in zip(chain.step[j], (x, y, up), strict=True)]
    return [x, y, up], total(position, *moved, scale(-chain.slide[j] * q, z))
