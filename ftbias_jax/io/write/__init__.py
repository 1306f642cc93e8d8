"""Results in the formats that other programs open: one module a format, all from the same named arrays."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

from ftbias_jax.errors import UsageError
from ftbias_jax.io.write.mcap import FRAME, save_mcap
from ftbias_jax.io.write.npz import save_npz
from ftbias_jax.io.write.provenance import Provenance
from ftbias_jax.io.write.table import save_csv, save_parquet
from ftbias_jax.types import Array


class About(NamedTuple):
    """What is to be said about a result beside its arrays."""

    start: float = 0.0
    """s, ``Log.start``, for absolute stamps."""
    frame: str = ""
    """The sensor's frame, ``Log.frame``."""
    origin: Provenance | None = None
    """What it was made from."""


Writer = Callable[[str | os.PathLike[str], Mapping[str, Array], About], None]

WRITERS: dict[str, Writer] = {
    ".npz": lambda path, arrays, about: save_npz(path, arrays, about.origin),
    ".parquet": lambda path, arrays, about: save_parquet(path, arrays, about.origin),
    ".csv": lambda path, arrays, _: save_csv(path, arrays),
    ".mcap": lambda path, arrays, about: save_mcap(path, arrays, about.start, about.frame or FRAME, about.origin),
}


def save_results(
    path: str | os.PathLike[str],
    arrays: Mapping[str, Array],
    start: float = 0.0,
    frame: str = "",
    origin: Provenance | None = None,
) -> None:
    """Write what a filter computed, in the format that the suffix names.

    Args:
        path: the file.
        arrays: ``Filtered._asdict()`` and what was added.
        start: s, ``Log.start``, for absolute stamps.
        frame: ``Log.frame``, for the messages of MCAP.
        origin: what it was made from; a CSV file has no place for it.

    Raises:
        UsageError: no format has this suffix. OutputError: the file cannot be written, or a package is missing.
    """
    writer(path)(path, arrays, About(start, frame, origin))


def writer(path: str | os.PathLike[str]) -> Writer:
    """The function that writes the format of a path, to ask before minutes are spent on computing."""
    suffix = Path(path).suffix.lower()
    if suffix not in WRITERS:
        remedy = f"end the name in {', '.join(WRITERS)}"
        raise UsageError(f"cannot write {os.fspath(path)!r}", field="--output", remedy=remedy)
    return WRITERS[suffix]
