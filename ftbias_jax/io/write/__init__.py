"""Writing of results in formats that other programs open: one module per format, all from the same named arrays."""

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
    """Write the result of a filter, in the format of the suffix.

    Raises:
        UsageError: no format has this suffix, or a field is absent. OutputError: the file cannot be written, or a
            package is missing.
    """
    about = about or About()
    writer(path)(path, selected(arrays, about.selection), about)


def writer(path: str | os.PathLike[str]) -> Writer:
    """Function that writes the format of a path; call it to check the suffix before minutes are spent on computing."""
    suffix = Path(path).suffix.lower()
    if suffix not in WRITERS:
        remedy = f"end the name in {', '.join(WRITERS)}"
        raise UsageError(f"cannot write {os.fspath(path)!r}", field="--output", remedy=remedy)
    return WRITERS[suffix]


def written(path: str | os.PathLike[str]) -> tuple[str, ...]:
    """Files written for a result: the file itself, and for CSV also the metadata file beside it."""
    name = os.fspath(path)
    return (name, companion(name)) if name.lower().endswith(".csv") else (name,)
