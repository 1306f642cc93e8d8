"""Static poses, the standard calibration: a table with one reading at rest per row, with or without time."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ftbias_jax.errors import LogError
from ftbias_jax.io.check import LOWEST_RATE, check_samples
from ftbias_jax.io.log import Log, Repair, Repairs
from ftbias_jax.io.pose import in_sensor_axes, pose_entries
from ftbias_jax.io.stamps.clock import seconds_of_a_unit, stamps_of
from ftbias_jax.io.tables.arrays import TABLES, native_arrays, suffix_of, with_pose
from ftbias_jax.setup.require import orientation_alone
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

FEWEST, MOST = 4, 1000
"""Number of poses; fewer cannot distinguish a weight from a bias, more are a log of motion."""


class Poses(NamedTuple):
    """Readings at rest, one per pose."""

    t: Float[Array, " N"]
    """(N,) s, or 0, 1, 2, ... where no time was recorded."""
    timed: bool
    """Whether the time was recorded."""
    q: Float[Array, "N n"]
    """(N, n) rad (m for prismatic joints); (N, 4) quaternion w, x, y, z if the setup has a sensor_pose."""
    wrench: Float[Array, "N 6"]
    """(N, 6) N and Nm with the sign convention of the report, as ``Log.wrench``."""
    repairs: Repairs = ()
    """Description of the poses that were left out."""

    @classmethod
    def from_arrays(
        cls,
        setup: Setup,
        wrench: Array,
        q: Array | None = None,
        *,
        orientation: Array | None = None,
        t: Array | None = None,
    ) -> Poses:
        """Build poses from arrays in memory, with the checks of ``read_poses``.

        Args:
            setup: gives the number of joints and the sensor's sign.
            wrench: (N, 6) N, Nm, sensor frame, as the sensor reports it: the mean over an interval at rest.
            q: (N, n) rad (m); None if the setup has a sensor_pose.
            orientation: (N, 4) or (N, 3, 3) of the sensor's mount in the base frame, as the setup's sensor_pose states.
            t: (N,) s; if None, the bias may drift from pose to pose, in the order of the rows.

        Raises:
            LogError: shapes disagree, a value is infinite, or there are fewer than FEWEST poses.
        """
        arrays = {"wrench": wrench, "q": q, "orientation": orientation, "t": t}
        return poses_from_arrays({name: values for name, values in arrays.items() if values is not None}, setup)


def read_poses(path: str | os.PathLike[str], setup: Setup) -> Poses:
    """Read a table of static poses: CSV, Parquet, NPZ or HDF5 with the names of a log, time optional.

    If the setup has a sensor_pose, only the orientation is read.

    Raises:
        LogError: the file cannot be read, or is not a table of 4 to 1000 readings at rest.
    """
    file = os.fspath(path)
    if suffix_of(file) not in TABLES:
        raise LogError("is no table of poses", file=file, remedy=f"give a file that ends in {', '.join(TABLES)}")
    setup = orientation_alone(setup)
    return poses_from_arrays(native_arrays(file, setup, static=True), setup, file)


def poses_from_arrays(arrays: Mapping[str, Array], setup: Setup, file: str = "") -> Poses:
    """Build poses from wrench (N, 6), q (N, n) or orientation, and optionally t (N,); other arrays are ignored."""
    setup = orientation_alone(setup)
    if setup.pose is not None and "q" not in arrays:
        arrays = with_pose(arrays, setup.pose, file)
    for name, what in (("q", "pose: q or orientation"), ("wrench", "reading: wrench (N, 6) N, Nm")):
        if name not in arrays:
            raise LogError(f"there is no {what}", file=file, field=name, remedy="record one of each a pose")
    q, wrench = np.asarray(arrays["q"]), np.asarray(arrays["wrench"])
    count = len(wrench) if wrench.ndim else 0
    t = np.arange(count, dtype=float)
    if timed := "t" in arrays:
        times = stamps_of(np.atleast_1d(arrays["t"]), setup.log)
        t = (times - times[:1]) * seconds_of_a_unit(times)
    if setup.pose is not None:
        q = pose_entries(q, None, t, setup, file).q
    log = check_samples(Log(t, q, np.full(np.shape(q), np.nan), wrench, np.full(count, np.nan)), setup, file=file)
    log = in_sensor_axes(log, setup, file)
    whole = np.isfinite(np.column_stack([t, log.q, log.wrench])).all(1)
    t, lost = t[whole], int((~whole).sum())
    _check(t, file)
    repairs = (Repair(f"{lost} of the {count} poses left out: not complete", lost=True),) if lost else ()
    return Poses(t, timed, log.q[whole], log.wrench[whole], repairs)


def as_log(poses: Poses) -> Log:
    """The poses as a log without velocities and temperatures, which are NaN."""
    unknown = np.full(poses.q.shape, np.nan)
    return Log(poses.t, poses.q, unknown, poses.wrench, unknown[:, 0], repairs=poses.repairs)


def _check(t: Array, file: str) -> None:
    if not FEWEST <= len(t) <= MOST:
        remedy = f"give {FEWEST} to {MOST} static poses, or a log of motion with its time"
        raise LogError(f"has {len(t)} poses", file=file, field="wrench", remedy=remedy)
    steps = np.diff(t)
    if (steps <= 0).any():
        remedy = "sort the poses by time, or leave the time out"
        raise LogError("time does not increase", file=file, field="t", remedy=remedy)
    if 1 / np.median(steps) > LOWEST_RATE:
        message = f"has a rate of {1 / np.median(steps):.3g} Hz, which is no series of static poses"
        raise LogError(message, file=file, field="t", remedy="read it as a log, or give one reading a pose")
