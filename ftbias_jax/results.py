"""Results on disk: named arrays in an uncompressed NPZ file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import BinaryIO

import numpy as np

from ftbias_jax.atomic import write_atomic
from ftbias_jax.npz_file import load_arrays
from ftbias_jax.types import Array


def save_npz(path: str | os.PathLike[str], arrays: Mapping[str, Array]) -> None:
    """Write named arrays; the same arrays give the same bytes.

    Raises:
        OutputError: the file cannot be written. ValueError: an array holds Python objects.
    """
    plain = {name: np.asarray(array) for name, array in arrays.items()}
    objects = [name for name, array in plain.items() if array.dtype.hasobject]
    if objects:
        raise ValueError(f"not plain numbers: {', '.join(objects)}")

    def write(file: BinaryIO) -> None:
        np.savez(file, **plain)  # type: ignore[arg-type]

    write_atomic(path, write)


def load_npz(path: str | os.PathLike[str]) -> dict[str, Array]:
    """Read what ``save_npz`` wrote.

    Raises:
        LogError: the file cannot be read.
    """
    return load_arrays(path)
