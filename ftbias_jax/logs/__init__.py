"""Recorded logs: one module a format, one check for all, one merged timeline out."""

from __future__ import annotations

import os
from pathlib import Path

from ftbias_jax.errors import LogError
from ftbias_jax.logs.csv import read_csv
from ftbias_jax.logs.npz import read_npz
from ftbias_jax.setup_types import Setup
from ftbias_jax.types import Log

READERS = {".npz": read_npz, ".csv": read_csv}


def read_log(path: str | os.PathLike[str], setup: Setup) -> Log:
    """Read a log in the format that its suffix names.

    Args:
        path: the file. setup: gives the number and names of the joints, the sensor's sign, and column names.

    Raises:
        LogError: the file cannot be read, or cannot be filtered with this setup (see ``check_log``).
    """
    reader = READERS.get(Path(path).suffix.lower())
    if reader is None:
        remedy = f"give a log that ends in {' or '.join(READERS)}"
        raise LogError(f"unknown format {Path(path).suffix!r}", file=os.fspath(path), remedy=remedy)
    return reader(path, setup)
