"""Logs as NPZ files: the native format."""

from __future__ import annotations

import os

from ftbias_jax.io.log import Log
from ftbias_jax.io.npz_archive import load_arrays
from ftbias_jax.io.tables.arrays import by_native_names, log_from_arrays, wanted_arrays
from ftbias_jax.setup.types import Setup

OURS = ("about", "provenance")
"""Arrays of a log that this program wrote: it has the native names, whatever [log.columns] says of recordings."""


def read_npz(path: str | os.PathLike[str], setup: Setup) -> Log:
    """Read the arrays of ``log_from_arrays``; others are ignored."""
    file = os.fspath(path)
    arrays = load_arrays(file, (*wanted_arrays(setup), *OURS))
    if not arrays.keys() >= set(OURS):
        arrays = by_native_names(arrays, setup, file)
    return log_from_arrays(arrays, setup, file)
