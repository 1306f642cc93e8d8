"""Conventions by which a log of a pose was recorded, as far as gravity and the log itself show them."""

from collections.abc import Callable, Iterator
from itertools import product
from typing import NamedTuple

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.draft.evidence import LEAST_SAMPLES, OUTLIER, ToolEstimate, usable_rows, weigh
from ftbias_jax.io.draft.robot import Keys
from ftbias_jax.io.draft.table import ALSO, Table
from ftbias_jax.io.log import Log
from ftbias_jax.io.pose import STANDARD_GRAVITY, between, interpolated, sensor_rotations
from ftbias_jax.io.stamps.clock import since, stamps_of
from ftbias_jax.setup.dump import Known
from ftbias_jax.setup.rotations import rpy_from_rotation
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

BETTER = 0.7
"""Share of the usual convention's residual below which another convention is preferred."""
EXPLAINS, USELESS = 0.9, 1.1
"""Ratios of force residuals: body axes must leave less than this of the base's, a position less than this of none."""
FEWEST = 20
"""Minimum number of tenths of a second, or of samples, for a comparison."""
SLOW = 10.0
"""Hz, rate at which positions and orientations are compared, low enough for encoder noise to vanish."""
ALIKE = 0.8
"""Correlation of gyroscope and orientation above which their magnitudes can be compared."""
NEAR = 1.25
"""Factor by which these magnitudes may differ."""
FARTHEST = 20.0
"""m, farther from the base than any robot reaches."""

MOUNTED, RIGID = 0.4, 0.7
"""Share of the residual that a turned mount must leave at most, and least ratio of the singular values of its map."""
UNUSUAL = {"sensor_pose.conjugate", "log.wrench_axes"}
"""Keys of conventions other than the usual one."""
LEAST_TURN, LEAST_DIP = 0.05, 0.001
"""Mean square changes below which a rotation is open: of the base axis, or the component of the unit vector of
gravity, that changes least in the sensor frame."""

Read = Callable[[Keys], tuple[Setup, Log]]
"""Reads the log with further keys."""


class Reading(NamedTuple):
    """A convention by which a log may be read, and what it then shows."""

    keys: Keys
    tool: ToolEstimate
    """In the axes of the sensor."""
    mount: Array
    """(3, 3) rotation of the sensor in the recorded frame."""


def best_reading(ways: Iterator[Keys], read: Read) -> Reading | None:
    """Convention with the smallest force residual, and the tool it shows; the usual one unless another is much better.

    With the usual axes, gravity may have any direction: with other axes the constant bias would turn like a weight, and
    explain a base that is not level. The sensor may be turned, if it is not as well explained without that. None if no
    convention lets the motion show the tool's weight.
    """
    best: Reading | None = None
    turned: Reading | None = None
    for keys in ways:
        try:
            setup, log = read(keys)
        except LogError:
            if not best:
                raise
            continue
        rotations, tried = sensor_rotations(log.t, log.q, setup), [(keys, setup.robot.gravity)]
        down = None if keys.keys() & UNUSUAL else likely_gravity(rotations, log.wrench)
        if down is not None:
            gravity = [round(float(x), 3) + 0.0 for x in down * np.linalg.norm(setup.robot.gravity)]
            words = "the base is not level: by the direction of the weight, if the sensor reports the usual sign"
            tried.append(({**keys, "robot.gravity": Known(gravity, words)}, np.array(gravity)))
        for further, gravity in tried:
            found = weigh(log.t, rotations, gravity, log.wrench)
            best = _better(best, further, found, np.eye(3))
        mount = likely_mount(rotations, setup.robot.gravity, log.wrench)
        if mount is not None:
            found = weigh(log.t, rotations @ mount, setup.robot.gravity, log.wrench)
            turned = _better(turned, keys, found, mount)
    return turned if best and turned and turned.tool.residual < MOUNTED * best.tool.residual else best


def _better(best: Reading | None, keys: Keys, found: ToolEstimate | None, mount: Array) -> Reading | None:
    """The best reading so far, or another one that leaves much less."""
    is_better = found and (best is None or found.residual < BETTER * best.tool.residual)
    return Reading(keys, found, mount) if found and is_better else best


def likely_mount(rotations: Array, gravity: Array, wrench: Array) -> Array | None:
    """Rotation (3, 3) of the sensor in the frame whose orientation is recorded, by the force; None if undetermined.

    A controller reports the pose of the tool frame that is active, which is turned and shifted relative to the flange.
    The weight is fitted by any linear map of gravity: the nearest rotation is the mount, and a map that mirrors is that
    of a sensor that reports the opposite sign.

    Args:
        rotations: (T, 3, 3) recorded frame in the base frame.
        gravity: (3,) m/s^2, base frame.
        wrench: (T, 6) N, Nm, as the sensor reports it.
    """
    rows = usable_rows(rotations, wrench)
    if len(rows) < LEAST_SAMPLES:
        return None
    support, force = -np.einsum("tji,j->ti", rotations[rows], gravity), wrench[rows, :3]
    if not np.isfinite(force).all():
        return None
    kept = np.ones(len(rows), bool)
    for _ in range(2):  # the second time without contact and fast motion
        swing, pull = support - support[kept].mean(0), force - force[kept].mean(0)
        normal = swing[kept].T @ swing[kept]
        if np.linalg.eigvalsh(normal)[0] < kept.sum() * LEAST_DIP * (gravity**2).sum():
            return None
        linear = np.linalg.solve(normal, swing[kept].T @ pull[kept]).T
        error = np.linalg.norm(pull - swing @ linear.T, axis=1)
        kept = error < OUTLIER * np.median(error) + 1e-9
    U, sizes, V = np.linalg.svd(linear)
    if sizes[-1] < RIGID * sizes[0]:
        return None
    rotation: Array = np.sign(np.linalg.det(U @ V)) * (U @ V).T
    return rotation


def likely_gravity(rotations: Array, wrench: Array) -> Array | None:
    """Direction (3,) of gravity in base axes, by least squares of weight and a constant; None if it is undetermined.

    Args:
        rotations: (T, 3, 3) sensor frame in the base frame.
        wrench: (T, 6) N, Nm, as the sensor reports it, with the usual sign.
    """
    rows = usable_rows(rotations, wrench)
    if len(rows) < LEAST_SAMPLES:
        return None
    turned = rotations[rows].swapaxes(1, 2)
    turned, force = turned - turned.mean(0), wrench[rows, :3] - wrench[rows, :3].mean(0)
    normal = np.einsum("tij,tik->jk", turned, turned)
    if np.linalg.eigvalsh(normal)[0] < len(rows) * LEAST_TURN:
        return None
    weight = np.linalg.solve(normal, np.einsum("tij,ti->j", turned, force))
    size = np.linalg.norm(weight)
    return -weight / size if size > 0 else None


def ways_of(table: Table) -> Iterator[Keys]:
    """Conventions by which an orientation and a wrench may have been recorded, the usual one first."""
    orders = [table.orientation] if table.named else [table.orientation, ALSO[table.orientation]]
    for axes, conjugate, order in product(("sensor", "base"), (False, True), orders):
        keys = {"sensor_pose.orientation": Known(order, "" if table.named else "as the weight fits best")}
        if table.degrees:
            keys["log.angle_unit"] = Known("deg", "because angles of the orientation exceed a turn in rad")
        if conjugate:
            keys["sensor_pose.conjugate"] = Known(True, "because the weight fits only then")
        if axes == "base":
            keys["log.wrench_axes"] = Known(axes, "because the weight fits only then")
        yield keys


def position_axes(read: Read, found: Reading) -> Keys:
    """Keys for the axes of the recorded position; it is not used if the tool's inertia explains none of the forces."""
    keys: Keys = {"sensor_pose.linear": Known("position", "its position is recorded")}
    setup, log = read(keys)
    if np.abs(log.q[np.isfinite(log.q[:, 4:]).all(1), 4:]).max(initial=0.0) > FARTHEST:
        keys["log.length_unit"] = Known("mm", "because no robot reaches so far in m")
        setup, log = read(keys)
    in_body = {"sensor_pose.position_axes": Known("body", "because the forces show its acceleration only then")}
    at_rest, base = _left_by_inertia(setup, log, found)
    _, body = _left_by_inertia(*read({**keys, **in_body}), found)
    if min(base, body) > USELESS * at_rest:
        return {"sensor_pose.linear": Known("none", "the forces do not show the acceleration of the recorded position")}
    return keys | in_body if body < EXPLAINS * base else keys


def _left_by_inertia(setup: Setup, log: Log, found: Reading) -> tuple[float, float]:
    """N, rms residual of the forces after weight and a constant, without and with the acceleration of the position."""
    rotations = (sensor_rotations(log.t, log.q, setup) @ found.mount).reshape(-1, 9)
    t, means = _slowly(log.t, np.column_stack([between(log.t, log.q[:, 4:], log.t), log.wrench[:, :3], rotations]))
    if len(t) < FEWEST:
        return 1.0, 1.0
    position, force, turned = means[:, :3], means[:, 3:6], means[:, 6:].reshape(-1, 3, 3)
    acceleration = np.gradient(np.gradient(position, t, axis=0), t, axis=0)
    left = []
    for felt in (-setup.robot.gravity, acceleration - setup.robot.gravity):
        error = force - found.tool.mass * np.einsum("tji,tj->ti", turned, np.broadcast_to(felt, position.shape))
        error = error - np.median(error, 0)
        left.append(float(np.sqrt((error[2:-2] ** 2).sum(1).mean())))
    return left[0], left[1]


def gyroscope(read: Read) -> Keys:
    """Keys for the gyroscope: whether it fits the orientation, and in which unit."""
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
    words = (
        f"it is {ratio:.2g} times the rate of the orientation"
        if alike > ALIKE
        else "it does not follow the rate of the orientation"
    )
    return {"sensor_pose.gyroscope": Known(False, words)}


def accelerometer(table: Table, read: Read) -> Keys:
    """Keys for unit and axes of an accelerometer, from the direction of gravity; {} if it does not measure gravity."""
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
    """Mean stamps and mean values of the measured rows in every tenth of a second."""
    known = np.isfinite(values).all(1)
    bins = np.floor(t[known] * SLOW).astype(int)
    kept = np.unique(bins)
    means = [(t[known][bins == k].mean(), values[known][bins == k].mean(0)) for k in kept]
    return np.array([at for at, _ in means]), np.array([mean for _, mean in means]).reshape(len(kept), values.shape[1])
