"""How a log of a pose was recorded, as far as gravity and the log itself show it."""

from collections.abc import Callable, Iterator
from itertools import product

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.draft.evidence import Weighed, weigh
from ftbias_jax.io.draft.robot import Keys
from ftbias_jax.io.draft.table import Table
from ftbias_jax.io.log import Log
from ftbias_jax.io.pose import STANDARD_GRAVITY, between, interpolated, sensor_rotations
from ftbias_jax.io.stamps.clock import since, stamps_of
from ftbias_jax.setup.dump import Known
from ftbias_jax.setup.rotations import rpy_from_rotation
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

BETTER = 0.7
"""Of what the usual convention leaves: another one must leave less."""
EXPLAINS, USELESS = 0.9, 1.1
"""Of the forces that remain: the body's axes must leave less of what the base's leave, a position less than none."""
FEWEST = 20
"""Tenths of a second, or samples, from which on there is something to compare."""
SLOW = 10.0
"""Hz at which positions and orientations are compared: encoders are no noise then."""
ALIKE = 0.8
"""Correlation of gyroscope and orientation from which their sizes can be compared."""
NEAR = 1.25
"""Factor by which they may differ."""

Read = Callable[[Keys], tuple[Setup, Log]]
"""Reads the log with further keys."""


def best_reading(ways: Iterator[Keys], read: Read) -> tuple[Keys, Weighed] | None:
    """The way that leaves least of the forces, and what it shows; the first one, unless another leaves much less.

    None, if the motion shows nothing of gravity in any way.
    """
    best: tuple[Keys, Weighed] | None = None
    for keys in ways:
        try:
            setup, log = read(keys)
        except LogError:
            if not best:
                raise
            continue
        found = weigh(log.t, sensor_rotations(log.t, log.q, setup), setup.robot.gravity, log.wrench)
        if found and (best is None or found.residual < BETTER * best[1].residual):
            best = keys, found
    return best


def ways_of(table: Table) -> Iterator[Keys]:
    """The ways in which an orientation and a wrench may have been recorded, the usual one first."""
    orders = [table.orientation] if table.named else ["quaternion_xyzw", "quaternion_wxyz"]
    for axes, conjugate, order in product(("sensor", "base"), (False, True), orders):
        keys = {"sensor_pose.orientation": Known(order, "" if table.named else "as the weight fits best")}
        if conjugate:
            keys["sensor_pose.conjugate"] = Known(True, "because the weight fits only then")
        if axes == "base":
            keys["log.wrench_axes"] = Known(axes, "because the weight fits only then")
        yield keys


def position_axes(read: Read, mass: float) -> Keys:
    """In whose axes the position is: the tool's inertia explains a part of the forces by it, or it is not used.

    ``mass`` is in kg, negative if the sensor reports the opposite sign.
    """
    at_rest, base = _left_by_inertia(read, "base", mass)
    _, body = _left_by_inertia(read, "body", mass)
    if min(base, body) > USELESS * at_rest:
        return {"sensor_pose.linear": Known("none", "the forces do not show the acceleration of the recorded position")}
    keys: Keys = {"sensor_pose.linear": Known("position", "its position is recorded")}
    if body < EXPLAINS * base:
        keys["sensor_pose.position_axes"] = Known("body", "because the forces show its acceleration only then")
    return keys


def _left_by_inertia(read: Read, axes: str, mass: float) -> tuple[float, float]:
    """N, rms of what weight and a constant leave of the forces, without and with the acceleration of the position."""
    setup, log = read({"sensor_pose.linear": Known("position"), "sensor_pose.position_axes": Known(axes)})
    rotations = sensor_rotations(log.t, log.q, setup).reshape(-1, 9)
    t, means = _slowly(log.t, np.column_stack([between(log.t, log.q[:, 4:], log.t), log.wrench[:, :3], rotations]))
    if len(t) < FEWEST:
        return 1.0, 1.0
    position, force, turned = means[:, :3], means[:, 3:6], means[:, 6:].reshape(-1, 3, 3)
    acceleration = np.gradient(np.gradient(position, t, axis=0), t, axis=0)
    left = []
    for felt in (-setup.robot.gravity, acceleration - setup.robot.gravity):
        error = force - mass * np.einsum("tji,tj->ti", turned, np.broadcast_to(felt, position.shape))
        error = error - np.median(error, 0)
        left.append(float(np.sqrt((error[2:-2] ** 2).sum(1).mean())))
    return left[0], left[1]


def gyroscope(read: Read) -> Keys:
    """Whether the gyroscope fits the orientation, and in which unit."""
    _, log = read({"sensor_pose.linear": Known("none")})
    measured = np.isfinite(log.dq[:, :4]).all(1)
    if not measured.any():
        return {}
    t, quaternion = _slowly(log.t, log.q[:, :4])
    _, rate = _slowly(log.t, log.dq[:, :4])
    if len(t) < 3 or len(t) != len(rate):
        return {}
    expected = np.gradient(quaternion, t, axis=0)
    alike = (expected * rate).sum() / np.sqrt((expected**2).sum() * (rate**2).sum() + 1e-300)
    ratio = (expected * rate).sum() / max((expected**2).sum(), 1e-300)
    if alike > ALIKE and 1 / NEAR < ratio < NEAR:
        return {}
    if alike > ALIKE and 1 / NEAR < ratio * np.pi / 180 < NEAR:
        return {"log.angle_unit": Known("deg", "because the gyroscope is 57 times the rate of the orientation")}
    words = f"it is {ratio:.2g} times the rate of the orientation" if alike > ALIKE else "it is another rate"
    return {"sensor_pose.gyroscope": Known(False, words)}


def accelerometer(table: Table, read: Read) -> Keys:
    """Unit and axes of an accelerometer, by the direction of gravity; {} if what it feels is not gravity."""
    setup, log = read({"sensor_pose.linear": Known("none")})
    assert table.accelerometer is not None
    felt = table.accelerometer
    t = log.t if table.time is None else since(stamps_of(table.time, setup.log), log.start)
    if len(t) != len(felt):
        return {}
    known = np.isfinite(log.q[:, :4]).all(1)
    inside = (t >= log.t[known][0]) & (t <= log.t[known][-1]) & np.isfinite(felt).all(1)
    rotations = sensor_rotations(t, between(log.t, interpolated(log.q[:, :4], log.t), t), setup)
    expected = -np.einsum("tji,j->ti", rotations, setup.robot.gravity)[inside]
    felt = felt[inside]
    if len(felt) < FEWEST:
        return {}
    in_g = np.median(np.linalg.norm(felt, axis=1)) < STANDARD_GRAVITY / 3
    felt = felt * (STANDARD_GRAVITY if in_g else 1.0)
    u, _, vt = np.linalg.svd(expected.T @ felt)
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt  # Kabsch: expected = turn felt
    left = np.sqrt(((felt @ turn.T - expected) ** 2).sum(1).mean())
    if left > STANDARD_GRAVITY / 4:
        return {}
    keys: Keys = {"sensor_pose.linear": Known("specific_force", "an accelerometer is recorded")}
    if in_g:
        keys["log.acceleration_unit"] = Known("g", "by the size of gravity")
    angles = [round(float(x), 4) + 0.0 for x in rpy_from_rotation(turn)]
    if max(map(abs, angles)) > 0.02:
        keys["sensor_pose.imu_rotation_rpy"] = Known(angles, f"by gravity, which leaves {left:.2g} m/s^2")
    return keys


def _slowly(t: Array, values: Array) -> tuple[Array, Array]:
    """Means of the measured rows of every tenth of a second."""
    known = np.isfinite(values).all(1)
    bins = np.floor(t[known] * SLOW).astype(int)
    kept = np.unique(bins)
    means = [(t[known][bins == k].mean(), values[known][bins == k].mean(0)) for k in kept]
    return np.array([at for at, _ in means]), np.array([mean for _, mean in means]).reshape(len(kept), values.shape[1])
