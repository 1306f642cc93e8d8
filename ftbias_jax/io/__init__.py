"""Recorded logs: one module a format, one check for all, one merged timeline out."""

from __future__ import annotations

import os
from pathlib import Path

from ftbias_jax.errors import LogError
from ftbias_jax.io.repairs import Reading
from ftbias_jax.io.ros.read import read_ros
from ftbias_jax.io.ros.record import PACKED, SUFFIXES
from ftbias_jax.io.tables.csv import read_csv
from ftbias_jax.io.tables.hdf5 import read_hdf5
from ftbias_jax.io.tables.npz import read_npz
from ftbias_jax.io.tables.parquet import read_parquet
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Log

READERS = {".npz": read_npz, ".csv": read_csv, ".parquet": read_parquet, ".h5": read_hdf5, ".hdf5": read_hdf5}


def read_log(path: str | os.PathLike[str], setup: Setup, *, salvage: bool = False) -> Log:
    """Read a log in the format that its suffix names, or a ROS 2 bag's folder.

    Args:
        path: the file.
        setup: gives the number and names of the joints, the sensor's sign, and column names.
        salvage: of a damaged ROS recording, read what is whole.

    Raises:
        LogError: the file cannot be read, or cannot be filtered with this setup (see ``check_log``).
    """
    return read_log_with_repairs(path, setup, salvage=salvage).log


def read_log_with_repairs(path: str | os.PathLike[str], setup: Setup, *, salvage: bool = False) -> Reading:
    """As ``read_log``, and what was repaired: recordings of ROS have late, repeated and missing stamps.

    The other formats are written on purpose: they are read as they are, or refused.
    """
    if is_ros(path):
        return read_ros(path, setup, salvage=salvage)
    reader = READERS.get(Path(path).suffix.lower())
    if reader is None:
        *most, last = (*READERS, *SUFFIXES)
        remedy = f"give a log that ends in {', '.join(most)} or {last}, or a ROS 2 bag's folder"
        raise LogError(f"unknown format {Path(path).suffix!r}", file=os.fspath(path), remedy=remedy)
    return Reading(reader(path, setup), ())


def is_ros(path: str | os.PathLike[str]) -> bool:
    """Whether the path names a recording of ROS: a folder, or one of its files."""
    name = os.fspath(path).lower().removesuffix(PACKED)
    return name.endswith(SUFFIXES) or os.path.isdir(path)
