"""Logs as NPZ files: the native format."""

from __future__ import annotations

import os

from ftbias_jax.io.log import Log
from ftbias_jax.io.npz_archive import load_arrays
from ftbias_jax.io.tables.arrays import by_native_names, log_from_arrays, wanted_arrays
from ftbias_jax.setup.types import Setup


def read_npz(path: str | os.PathLike[str], setup: Setup) -> Log:
    """Read the arrays of ``log_from_arrays``; others are ignored.

    Raises:
        LogError: the file cannot be read, an array is missing, or the log cannot be filtered (see ``check_log``).
    """
    file = os.fspath(path)
    return log_from_arrays(by_native_names(load_arrays(file, wanted_arrays(setup)), setup, file), setup, file)
