"""Results in the formats that other programs open: one module a format, all from the same named arrays."""

import os
from collections.abc import Callable, Mapping
from pathlib import Path

from ftbias_jax.errors import UsageError
from ftbias_jax.io.write.mcap import save_mcap
from ftbias_jax.io.write.npz import save_npz, texts_of
from ftbias_jax.io.write.selection import About, selected
from ftbias_jax.io.write.table import companion, save_csv, save_parquet
from ftbias_jax.types import Array

Writer = Callable[[str | os.PathLike[str], Mapping[str, Array], About], None]

WRITERS: dict[str, Writer] = {
    ".npz": lambda path, arrays, about: save_npz(path, {**arrays, **texts_of(arrays, about)}),
    ".parquet": save_parquet,
    ".csv": save_csv,
    ".mcap": save_mcap,
}


def save_results(path: str | os.PathLike[str], arrays: Mapping[str, Array], about: About | None = None) -> None:
    """Write what a filter computed, in the format that the suffix names.

    Raises:
        UsageError: no format has this suffix, or a field is not there. OutputError: the file cannot be written, or a
            package is missing.
    """
    about = about or About()
    writer(path)(path, selected(arrays, about.selection), about)


def writer(path: str | os.PathLike[str]) -> Writer:
    """The function that writes the format of a path, to ask before minutes are spent on computing."""
    suffix = Path(path).suffix.lower()
    if suffix not in WRITERS:
        remedy = f"end the name in {', '.join(WRITERS)}"
        raise UsageError(f"cannot write {os.fspath(path)!r}", field="--output", remedy=remedy)
    return WRITERS[suffix]


def written(path: str | os.PathLike[str]) -> tuple[str, ...]:
    """The files that a result becomes: the file itself, and the description beside one of CSV."""
    name = os.fspath(path)
    return (name, companion(name)) if name.lower().endswith(".csv") else (name,)
