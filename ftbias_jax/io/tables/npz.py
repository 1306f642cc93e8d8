"""Logs as NPZ files: the native format."""

from __future__ import annotations

import os

from ftbias_jax.io.log import Log
from ftbias_jax.io.npz_archive import load_arrays
from ftbias_jax.io.tables.arrays import ARRAYS, POSE_ARRAYS, log_from_arrays
from ftbias_jax.setup.types import Setup


def read_npz(path: str | os.PathLike[str], setup: Setup) -> Log:
    """Read the arrays of ``log_from_arrays``; others are ignored.

    Raises:
        LogError: the file cannot be read, an array is missing, or the log cannot be filtered (see ``check_log``).
    """
    file = os.fspath(path)
    return log_from_arrays(load_arrays(file, (*ARRAYS, *POSE_ARRAYS)), setup, file)
