"""Limits of a planned motion: travel, speed, acceleration and jerk of joints, and regions for points of the arm.

The robot's own body and its surroundings are not modelled here.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ftbias_jax.errors import UsageError
from ftbias_jax.model.kinematics.arm_batch import ArmMotion
from ftbias_jax.setup.types import LimitsSetup, Setup
from ftbias_jax.types import Array

REACH = 0.8
"""rad (m); assumed travel to either side of the first pose, where that of a joint is not known."""
SPEED = 1.0
"""rad/s (m/s); assumed top speed, where that of a joint is not known."""
RISE, ONSET = 0.5, 0.1
"""s; assumed times in which a joint reaches its top speed and its largest acceleration, where these are not stated."""
SOFT = 0.1
"""m or rad^2; unit in which an excess over the box, the floor and the cone is counted."""
QUANTITIES = ("position", "velocity", "acceleration", "jerk")
NOT_KNOWN = (
    "Not known to the plan, and not checked: collisions of the arm with itself, the tool's shape beyond its tip, "
    "cables, whatever stands in the cell, and the payload that the controller allows. Run it slowly first, with a hand "
    "on the stop."
)


class Limits(NamedTuple):
    """Limits after deduction of the margin; infinite where there is none. A pytree."""

    lower: Float[Array, " n"]
    """(n,) rad (m), lower ends of the joints' travel."""
    upper: Float[Array, " n"]
    velocity: Float[Array, " n"]
    """(n,) rad/s (m/s)."""
    acceleration: Float[Array, " n"]
    """(n,) rad/s^2 (m/s^2)."""
    jerk: Float[Array, " n"]
    """(n,) rad/s^3 (m/s^3)."""
    points: Float[Array, "K 3"]
    """(K, 3) m, sensor frame: flange, sensor, centre of mass and tip."""
    box: Float[Array, "2 3"]
    """(2, 3) m, base frame: lowest and highest corner."""
    up: Float[Array, " 3"]
    """(3,) unit vector against gravity, base frame."""
    floor: Float[Array, ""]
    """() m, lowest height along ``up``."""
    keep_axis: Float[Array, " 3"]
    """(3,) unit vector, sensor frame, whose tilt is limited."""
    keep_cosine: Float[Array, ""]
    """() smallest cosine of the angle between that axis and its direction in the first pose; -inf = any."""
    wrench: Float[Array, " 6"]
    """(6,) N, Nm, largest wrench of the tool on the sensor."""


def limits_of(setup: Setup, start: Float[np.ndarray, " n"], margin: float) -> tuple[Limits, tuple[str, ...]]:
    """Return the limits for motions from a pose (n,) rad, and descriptions of those assumed for lack of a statement.

    The robot's own limits apply where [limits] states none; ``margin`` is the share of every range that is left unused.
    """
    stated, robot, assumed = setup.limits, setup.robot, []
    lowest, highest = (np.full(len(start), x) for x in (-np.inf, np.inf))
    if robot.position_limits is not None:
        lowest, highest = np.array(robot.position_limits, float).T
    if stated.position_lower is not None:
        lowest = np.asarray(stated.position_lower)
    if stated.position_upper is not None:
        highest = np.asarray(stated.position_upper)
    if not (np.isfinite(lowest) & np.isfinite(highest)).all():
        assumed.append(f"joints without stated travel stay within {REACH:g} rad (m) of the first pose")
    lower = np.where(np.isfinite(lowest), lowest, start - REACH)
    upper = np.where(np.isfinite(highest), highest, start + REACH)
    spare = margin * (upper - lower) / 2
    speed = np.full(len(start), np.nan) if robot.velocity_limits is None else np.array(robot.velocity_limits, float)
    speed = speed if stated.velocity is None else np.asarray(stated.velocity)
    if not np.isfinite(speed).all():
        assumed.append(f"joints without a stated top speed keep below {SPEED:g} rad/s (m/s)")
        speed = np.where(np.isfinite(speed), speed, SPEED)
    acceleration, jerk = stated.acceleration, stated.jerk
    if acceleration is None:
        assumed.append(f"acceleration: top speed in {RISE:g} s")
        acceleration = speed / RISE
    if jerk is None:
        assumed.append(f"jerk: largest acceleration in {ONSET:g} s")
        jerk = acceleration / ONSET
    up = -np.asarray(robot.gravity) / max(float(np.linalg.norm(robot.gravity)), 1e-9)
    share = 1 - margin
    rates = (share * np.asarray(x) for x in (speed, acceleration, jerk))
    return Limits(lower + spare, upper - spare, *rates, *_space(setup, stated, up, share)), tuple(assumed)


def _space(setup: Setup, stated: LimitsSetup, up: np.ndarray, share: float) -> tuple[np.ndarray, ...]:
    """Monitored points and the regions allowed for them, and the largest wrench."""
    flange = -setup.sensor.rotation.T @ setup.sensor.translation
    center = np.nan_to_num(setup.tool.center_of_mass)
    points = np.stack([flange, np.zeros(3), center, center if stated.tip is None else stated.tip])
    corners = ((stated.box_lower, -np.inf), (stated.box_upper, np.inf))
    box = np.stack([np.full(3, none) if corner is None else corner for corner, none in corners])
    axis = np.asarray(stated.keep_axis, float)
    cosine = -np.inf if stated.keep_angle is None else np.cos(share * stated.keep_angle)
    wrench = np.full(6, np.inf) if stated.wrench is None else share * stated.wrench
    floor = -np.inf if stated.floor is None else stated.floor
    return points, box, up, np.array(floor), axis / np.linalg.norm(axis), np.array(cosine), wrench


def joint_shares(limits: Limits, start: Float[Array, " n"], motion: Float[Array, "4 U n"]) -> Float[Array, "4 U n"]:
    """Share of its limits that each joint uses: (4, U, n) of position, velocity, acceleration and jerk; 1 = all.

    The motion (4, U, n) holds positions relative to the start (n,), rad, and their three derivatives.
    """
    position, *rates = motion
    room = jnp.where(position > 0, (limits.upper - start)[None], (start - limits.lower)[None])
    bounds = jnp.stack([limits.velocity, limits.acceleration, limits.jerk])[:, None]
    return jnp.concatenate([(jnp.abs(position) / room)[None], jnp.abs(jnp.stack(rates)) / bounds])


def excess(limits: Limits, moving: ArmMotion, wrench: Float[Array, "U 6"]) -> Float[Array, "4 U"]:
    """Excess over the limits of box, floor, cone and wrench, the worst of each: (4, U), 0 or less = kept.

    The arm is in its first pose in the first sample; the wrench (U, 6) N, Nm is that of the tool on the sensor.
    """
    rotation, origin = moving.sensor_rotation, moving.sensor_position
    points = origin[None] + jnp.einsum("ijt,kj->kit", rotation, limits.points)
    lowest, highest = limits.box
    outside = jnp.maximum(lowest[None, :, None] - points, points - highest[None, :, None]).max((0, 1))
    below = (limits.floor - jnp.einsum("i,kit->kt", limits.up, points)).max(0)
    axis = jnp.einsum("ijt,j->it", rotation, limits.keep_axis)
    tilt = limits.keep_cosine - axis[:, 0] @ axis
    load = (jnp.abs(wrench) / limits.wrench[None] - 1).max(1)
    return jnp.stack([outside / SOFT, below / SOFT, tilt / SOFT, load])


SPACE = ("box", "floor", "orientation", "wrench")
"""Names of the rows of ``excess``."""


def check_start(limits: Limits, start: np.ndarray, names: tuple[str, ...], at_rest: np.ndarray) -> None:
    """Raise an error if the first pose (n,) rad is outside the limits; ``at_rest`` (4,) is the ``excess`` there.

    Raises:
        UsageError: a joint or a point is outside its limits.
    """
    remedy = "start elsewhere (--start), state wider [limits], or a smaller --margin"
    for name, q, lower, upper in zip(names, start, limits.lower, limits.upper, strict=True):
        if not lower < q < upper:
            message = f"{name} at {q:.4g} is outside of {lower:.4g} to {upper:.4g} rad (m), the margin taken off"
            raise UsageError(message, field="start", remedy=remedy)
    for name, over in zip(SPACE, at_rest, strict=True):
        if over > 0:
            raise UsageError(f"the first pose is outside of the limit on {name}", field="start", remedy=remedy)
