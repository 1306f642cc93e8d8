"""Conversion of recorded poses to the entries that the joint filter tracks, and sensor orientation at every stamp.

Quaternions without sign jumps, positions, rates from an IMU; wrenches that are recorded in the axes of the base.
"""

from typing import NamedTuple

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.accelerometer import Calibration, calibrate_accelerometer
from ftbias_jax.io.log import Log, Repair, Repairs
from ftbias_jax.setup.recorded import LENGTH_UNITS, OF_ANGLES, PoseSetup
from ftbias_jax.setup.rotations import quaternions_of, skew
from ftbias_jax.setup.types import RobotSetup, SensorSetup, Setup
from ftbias_jax.types import Array

STANDARD_GRAVITY = 9.80665
"""m/s^2: the unit g of accelerometers."""
TOLERANCE = 0.05
"""Tolerance of a quaternion's length and a matrix's entries: rounded numbers pass, other quantities do not."""


class PoseEntries(NamedTuple):
    """A recorded pose in the form of joint positions and rates."""

    q: Array
    """(T, 4 or 7) quaternion w, x, y, z and position m, base frame."""
    dq: Array
    """(T, 4 or 7) rates of the entries of q."""
    acceleration_std: Array = np.zeros(3)
    """(3,) m/s^2, sensor axes: standard deviation of the remaining error of the accelerometer."""
    repairs: Repairs = ()
    """Report of the correction of its readings."""


def pose_entries(pose: Array, rates: Array | None, t: Array, setup: Setup, file: str = "") -> PoseEntries:
    """Entries of the pose and their rates, as if they were joints (``free_body``).

    Args:
        pose: (T, k) orientation in the order the setup states, then position, base frame, if the setup uses it.
        rates: (T, 3 or 6) angular velocity and specific force (a - g), whichever the setup uses, or None. NaN = not
            measured.
        t: (T,) s.
        setup: has a sensor_pose.
        file: file name for error messages.

    Returns:
        entries and their rates. A specific force, corrected for the accelerometer's error at rest
        (``calibrate_accelerometer``), is integrated to a velocity, and the position is left unknown: the wrench
        depends on neither, only on the acceleration that the filter derives from them.
    """
    stated = setup.pose
    assert stated is not None
    pose = _columns(pose, stated.columns[0], "pose", file)
    split = stated.orientation_columns
    quaternion = _as_recorded(pose[:, :split], stated.orientation, setup.log.angle_unit, file)
    quaternion = continuous(quaternion * (np.array([1.0, -1, -1, -1]) if stated.conjugate else 1.0))
    dq, calibration = np.full((len(t), len(setup.robot.joint_names)), np.nan), None
    q = dq.copy()
    q[:, :4] = quaternion
    if stated.linear == "position":
        q[:, 4:] = LENGTH_UNITS[setup.log.length_unit] * pose[:, split:]
        if stated.position_axes == "body" and np.isfinite(quaternion).all(1).any():
            q[:, 4:] = rotate(interpolated(quaternion, t), q[:, 4:])
    recorded = rates is not None and np.isfinite(rates).any()
    if not recorded and stated.linear == "specific_force":
        raise LogError(
            "there is no specific force", file=file, field="specific_force", remedy='record it, or set linear = "none"'
        )
    if recorded and np.isfinite(quaternion).all(1).any():
        rates = _imu(rates, setup, stated, file)
        at_imu = interpolated(quaternion, t)
        turn = rates[:, :3] @ setup.sensor.rotation.T
        dq[:, :4] = product(at_imu, np.column_stack([np.zeros(len(t)), turn])) / 2
        if stated.linear == "specific_force":
            q[0, 4:] = 0
            dq[:, 4:], calibration = _velocity(at_imu, rates[:, 3:], t, setup)
    return PoseEntries(q, dq) if calibration is None else PoseEntries(q, dq, calibration.std, _remark(calibration))


def continuous(quaternion: Array) -> Array:
    """Quaternions (T, 4) with continuous signs, because q and -q are one rotation; NaN stays."""
    result = quaternion.copy()
    rows = np.flatnonzero(np.isfinite(quaternion).all(1))
    dots = (quaternion[rows[1:]] * quaternion[rows[:-1]]).sum(1)
    result[rows[1:]] *= np.cumprod(np.where(dots < 0, -1.0, 1.0))[:, None]
    return result


def product(left: Array, right: Array) -> Array:
    """Product of quaternions (..., 4) in the order w, x, y, z: the right rotation is applied first."""
    w, v, s, u = left[..., :1], left[..., 1:], right[..., :1], right[..., 1:]
    scalar = w * s - (v * u).sum(-1, keepdims=True)
    return np.concatenate([scalar, w * u + s * v + np.cross(v, u)], -1)


def rotate(quaternion: Array, vectors: Array) -> Array:
    """Rotate vectors (T, 3) by unit quaternions (T, 4)."""
    w, v = quaternion[:, :1], quaternion[:, 1:]
    twice = 2 * np.cross(v, vectors)
    return vectors + w * twice + np.cross(v, twice)


def _imu(rates: Array, setup: Setup, stated: PoseSetup, file: str) -> Array:
    """(T, 6) angular velocity rad/s and specific force m/s^2 in the sensor's axes; NaN for what is not recorded."""
    rates, width = np.asarray(rates), stated.columns[1]
    if width == 6 and rates.ndim == 2 and rates.shape[1] == 3:  # an IMU without a gyroscope
        rates = np.concatenate([np.full(rates.shape, np.nan), rates], 1)
    rates = _columns(rates, width, "rates", file)
    gyroscope, accelerometer = np.full((2, len(rates), 3), np.nan)
    if stated.gyroscope:
        gyroscope = rates[:, :3] * (np.pi / 180 if setup.log.angle_unit == "deg" else 1.0)
    if stated.linear == "specific_force":
        accelerometer = rates[:, -3:] * (STANDARD_GRAVITY if setup.log.acceleration_unit == "g" else 1.0)
    return np.concatenate([gyroscope @ stated.imu_rotation.T, accelerometer @ stated.imu_rotation.T], 1)


def _as_recorded(orientation: Array, order: str, unit: str, file: str) -> Array:
    """Recorded orientations as (T, 4) unit quaternions w, x, y, z; NaN for rows that were not measured."""
    if order in OF_ANGLES:
        angles = orientation * (np.pi / 180 if unit == "deg" else 1.0)
        if order == "axis_angle":
            return _turns(angles)
        about_x, about_y, about_z = (_turns(angles * axis) for axis in np.eye(3))
        return product(about_z, product(about_y, about_x))
    if order == "matrix":
        matrices = orientation.reshape(-1, 3, 3)
        off = np.abs(np.einsum("tij,tkj->tik", matrices, matrices) - np.eye(3)).max((1, 2))
        with np.errstate(invalid="ignore"):  # rows that were not measured
            off = np.maximum(off, np.abs(np.linalg.det(matrices) - 1))
        _refuse(off > TOLERANCE, "is no rotation matrix", file)
        return quaternions_of(matrices)
    quaternion = orientation[:, [3, 0, 1, 2]] if order == "quaternion_xyzw" else orientation
    length = np.linalg.norm(quaternion, axis=1, keepdims=True)
    length[length == 0] = np.nan  # recorders write zeros for "not known"
    _refuse(np.abs(length[:, 0] - 1) > TOLERANCE, "is no quaternion of length one", file)
    return quaternion / length


def _turns(vectors: Array) -> Array:
    """Unit quaternions (T, 4) w, x, y, z of rotation vectors (T, 3) rad."""
    half = np.linalg.norm(vectors, axis=1, keepdims=True) / 2
    return np.concatenate([np.cos(half), np.sinc(half / np.pi) * vectors / 2], 1)


def _refuse(bad: Array, what: str, file: str) -> None:
    if bad.any():
        remedy = "record rotations, and state their order in the setup: sensor_pose.orientation"
        raise LogError(f"sample {np.flatnonzero(bad)[0]} {what}", file=file, field="orientation", remedy=remedy)


def between(t: Array, values: Array, at: Array) -> Array:
    """Values (A, k) at stamps (A,), linearly interpolated between the complete rows of (T, k) at t (T,)."""
    known = np.isfinite(values).all(1)
    return np.stack([np.interp(at, t[known], column[known]) for column in values.T], 1)


def interpolated(quaternion: Array, t: Array) -> Array:
    """Unit quaternions (T, 4) at all stamps (T,), interpolated between the measured ones."""
    values = between(t, quaternion, t)
    return values / np.linalg.norm(values, axis=1, keepdims=True)


def _remark(calibration: Calibration) -> Repairs:
    sizes = np.abs(calibration.correction).max(0), calibration.std
    off, left = (" ".join(f"{x:.2g}" for x in each) for each in sizes)
    known = f"which is known to within {left} m/s^2: the error bars contain that"
    if calibration.correction.any():
        at_rest = f"by up to {off} m/s^2 from gravity at rest and in slow motion"
        what = f"the accelerometer deviates {at_rest}: corrected, {known}"
    else:
        what = f"the log does not show what the accelerometer is off by, {known}"
    return (Repair(what),)


def _velocity(quaternion: Array, specific_force: Array, t: Array, setup: Setup) -> tuple[Array, Calibration | None]:
    """(T, 3) m/s, velocity of the sensor from rest, base frame: the integral of measured specific force and gravity.

    Also returns the calibration by which the specific force was corrected, if any.
    """
    rows = np.flatnonzero(np.isfinite(specific_force).all(1))
    at, force, gravity = quaternion[rows], specific_force[rows], np.broadcast_to(setup.robot.gravity, (len(rows), 3))
    against = -rotate(at * np.array([1.0, -1, -1, -1]), gravity) @ setup.sensor.rotation
    found = calibrate_accelerometer(t[rows], force, against)
    off = 0.0 if found is None else found.correction
    acceleration = rotate(at, (force - off) @ setup.sensor.rotation.T) + gravity
    steps = (acceleration[1:] + acceleration[:-1]) / 2 * np.diff(t[rows])[:, None]
    velocity = np.full((len(t), 3), np.nan)
    velocity[rows] = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, 0)])[: len(rows)]
    return velocity, found


def _columns(values: Array, count: int, field: str, file: str) -> Array:
    values = np.asarray(values)
    if values.ndim != 2 or values.shape[1] != count or values.dtype.kind not in "fiu":
        message = f"has shape {values.shape} and type {values.dtype}, expected {count} columns of numbers"
        raise LogError(message, file=file, field=field, remedy="record what sensor_pose of the setup says")
    return values.astype(np.float64)


def arm_rotations(robot: RobotSetup, sensor: SensorSetup, q: Array) -> Array:
    """(T, 3, 3) sensor frame in the base frame, for joint positions (T, n)."""
    rotation = np.broadcast_to(np.eye(3), (len(q), 3, 3))
    for screw, angle in zip(robot.screws, q.T, strict=True):
        K = skew(screw[3:])
        turn = np.eye(3) + np.sin(angle)[:, None, None] * K + (1 - np.cos(angle))[:, None, None] * (K @ K)
        rotation = rotation @ turn
    return rotation @ robot.flange_rotation @ sensor.rotation


def sensor_rotations(t: Array, q: Array, setup: Setup, file: str = "") -> Array:
    """(T, 3, 3) sensor frame in the base frame at all stamps (T,) s, interpolated between rows with joints or a pose.

    ``q`` (T, n) are joints or entries of the pose; NaN = not measured.
    """
    known = np.isfinite(q[:, :4] if setup.pose else q).all(1)
    if not known.any():
        what = "orientation" if setup.pose else "row with all joints"
        raise LogError(f"no motion data: there is no {what}", file=file, field="q", remedy="record it")
    if setup.pose is not None:
        quaternion = interpolated(q[:, :4], t)
        columns = [rotate(quaternion, np.tile(axis, (len(t), 1))) for axis in setup.sensor.rotation.T]
        return np.stack(columns, 2)
    return arm_rotations(setup.robot, setup.sensor, between(t, q, t))


def in_sensor_axes(log: Log, setup: Setup, file: str = "") -> Log:
    """Convert the wrench of a log from the axes that the setup states to the sensor's axes, about the same point."""
    if setup.log.wrench_axes == "sensor":
        return log
    rotations = sensor_rotations(log.t, log.q, setup, file)
    parts = [np.einsum("tji,tj->ti", rotations, log.wrench[:, half]) for half in (slice(0, 3), slice(3, 6))]
    return log._replace(wrench=np.concatenate(parts, 1))
