"""Results in the formats that other programs open: one module a format, all from the same named arrays."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path

from ftbias_jax.errors import UsageError
from ftbias_jax.io.write.mcap import save_mcap
from ftbias_jax.io.write.npz import save_npz
from ftbias_jax.io.write.table import save_csv, save_parquet
from ftbias_jax.types import Array

Writer = Callable[[str | os.PathLike[str], Mapping[str, Array], float], None]

WRITERS: dict[str, Writer] = {
    ".npz": lambda path, arrays, _: save_npz(path, arrays),
    ".parquet": lambda path, arrays, _: save_parquet(path, arrays),
    ".csv": lambda path, arrays, _: save_csv(path, arrays),
    ".mcap": save_mcap,
}


def save_results(path: str | os.PathLike[str], arrays: Mapping[str, Array], start: float = 0.0) -> None:
    """Write what a filter computed, in the format that the suffix names.

    Args:
        path: the file.
        arrays: ``Filtered._asdict()`` and what was added.
        start: s, ``Log.start``, for absolute stamps.

    Raises:
        UsageError: no format has this suffix. OutputError: the file cannot be written, or a package is missing.
    """
    writer(path)(path, arrays, start)


def writer(path: str | os.PathLike[str]) -> Writer:
    """The function that writes the format of a path, to ask before minutes are spent on computing."""
    suffix = Path(path).suffix.lower()
    if suffix not in WRITERS:
        remedy = f"end the name in {', '.join(WRITERS)}"
        raise UsageError(f"cannot write {os.fspath(path)!r}", field="--output", remedy=remedy)
    return WRITERS[suffix]
