"""Results on disk: named arrays in an uncompressed NPZ file."""

import json
import os
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from math import prod
from typing import IO, BinaryIO

import numpy as np

from ftbias_jax.io.atomic import write_atomic
from ftbias_jax.io.tables.array_files import load_arrays
from ftbias_jax.io.write import selection
from ftbias_jax.io.write.fields import LOG_UNITS
from ftbias_jax.io.write.provenance import Provenance, as_text
from ftbias_jax.io.write.selection import About
from ftbias_jax.types import Array

COPY = 1 << 20
"""Number of bytes per copy step."""


def save_npz(path: str | os.PathLike[str], arrays: Mapping[str, Array]) -> None:
    """Write named arrays; the same arrays give the same bytes."""
    plain = {name: np.asarray(array) for name, array in arrays.items()}
    objects = [name for name, array in plain.items() if array.dtype.hasobject]
    if objects:
        raise ValueError(f"not plain numbers: {', '.join(objects)}")

    def write(file: BinaryIO) -> None:
        np.savez(file, **plain)  # type: ignore[arg-type]

    write_atomic(path, write)


def save_npz_parts(
    path: str | os.PathLike[str], parts: Iterable[Mapping[str, Array]], about: Callable[[], About] = About
) -> None:
    """Write named arrays that come in parts: the parts of an array one after the other, of a () array their sum.

    The parts are kept in unnamed temporary files beside ``path``, which vanish with this process, until all parts have
    come: the folder needs room for the result twice. There is one part at least; all have the same names, types and
    shapes behind the first axis. ``about`` is called after the last part.
    """
    folder = os.path.dirname(os.path.realpath(path))

    def write(file: BinaryIO) -> None:
        with ExitStack() as stack:
            first: dict[str, Array] = {}
            sums: dict[str, Array] = {}
            spools: dict[str, IO[bytes]] = {}
            for part in parts:
                for name, array in part.items():
                    array = np.asarray(array)
                    if name not in first:
                        first[name] = array[:0] if array.ndim else array
                        spools[name] = stack.enter_context(tempfile.TemporaryFile(dir=folder))
                    sums[name] = sums.get(name, 0) + array if array.ndim == 0 else 0
                    spools[name].write(np.ascontiguousarray(array).data if array.ndim else b"")
            with zipfile.ZipFile(file, "w") as archive:
                for name, like in first.items():
                    with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as member:
                        _write_array(member, like, sums[name], spools[name])
                for name, text in texts_of(first, about()).items():
                    with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w") as member:
                        np.lib.format.write_array(member, text, allow_pickle=False)

    write_atomic(path, write)


def texts_of(names: Iterable[str], about: About) -> dict[str, Array]:
    """Metadata of the arrays, as arrays of one text each."""
    return {name: np.array(text) for name, text in selection.texts_of(names, about).items()}


def texts_of_log(names: Iterable[str], reports: str, origin: Provenance) -> dict[str, Array]:
    """Metadata of a log, or of its ground truth, as arrays of one text each."""
    units = {name: LOG_UNITS[name] for name in names if name in LOG_UNITS}
    about = {"reports": reports, "frame": "sensor", "units": units}
    return {"about": np.array(json.dumps(about)), "provenance": np.array(as_text(origin))}


def _write_array(member: IO[bytes], like: Array, total: Array, rows: IO[bytes]) -> None:
    """Write an array in NPY format: the total if it is a scalar, otherwise the rows in a file."""
    if like.ndim == 0:
        np.lib.format.write_array(member, np.asarray(total, like.dtype))
        return
    count = rows.tell() // (prod(like.shape[1:]) * like.dtype.itemsize)
    header = {"descr": like.dtype.str, "fortran_order": False, "shape": (count, *like.shape[1:])}
    np.lib.format.write_array_header_1_0(member, header)
    rows.seek(0)
    shutil.copyfileobj(rows, member, COPY)


def load_npz(path: str | os.PathLike[str]) -> dict[str, Array]:
    """Read what ``save_npz`` wrote."""
    return load_arrays(path)
