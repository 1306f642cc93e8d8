"""Results as tables: one row a wrench sample, one column a number; CSV and Parquet."""

from __future__ import annotations

import importlib
import os
from collections.abc import Mapping
from typing import BinaryIO

import numpy as np

from ftbias_jax.errors import OutputError
from ftbias_jax.io.atomic import write_atomic
from ftbias_jax.io.write.provenance import Provenance, as_text
from ftbias_jax.types import AXES, Array

JOINT_ARRAYS = ("q", "dq", "ddq", "ddq_std")
"""Arrays with a column a joint; all others of two dimensions have a column an axis of the wrench."""


def table(arrays: Mapping[str, Array]) -> dict[str, Array]:
    """The (T,) columns of a result by name: ``t``, ``bias_fx``, ``q0``; a scalar is repeated in every row.

    Args:
        arrays: () or (T,) or (T, k) each; one of them is t (T,).

    Raises:
        ValueError: an array has another shape.
    """
    length = len(arrays["t"])
    columns: dict[str, Array] = {}
    for name, values in arrays.items():
        values = np.asarray(values)
        if values.ndim == 0:
            columns[name] = np.full(length, values)
        elif values.shape == (length,):
            columns[name] = values
        elif values.ndim == 2 and len(values) == length and (name in JOINT_ARRAYS or values.shape[1] == len(AXES)):
            joints = [f"{name}{i}" for i in range(values.shape[1])]
            names = joints if name in JOINT_ARRAYS else [f"{name}_{axis}" for axis in AXES]
            columns |= zip(names, values.T, strict=True)
        else:
            raise ValueError(f"{name} has shape {values.shape} in a result of {length} samples")
    return columns


def save_csv(path: str | os.PathLike[str], arrays: Mapping[str, Array]) -> None:
    """Write a header line and a line a sample, with all digits that a float64 has.

    Raises:
        OutputError: the file cannot be written.
    """
    columns = table(arrays)

    def write(file: BinaryIO) -> None:
        header = ",".join(columns)
        np.savetxt(file, np.column_stack(list(columns.values())), "%.17g", ",", header=header, comments="")

    write_atomic(path, write)


def save_parquet(path: str | os.PathLike[str], arrays: Mapping[str, Array], origin: Provenance | None = None) -> None:
    """Write a Parquet file that pandas, Polars and DuckDB read.

    Args:
        path: the file.
        arrays: as for ``table``.
        origin: what they were made from, kept in the metadata of the schema under ``ftbias``.

    Raises:
        OutputError: the file cannot be written, or pyarrow is not installed.
    """
    try:
        arrow, parquet = importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
    except ImportError as error:
        remedy = "pip install 'ftbias-jax[parquet]'"
        raise OutputError("writing it needs the package pyarrow", file=path, remedy=remedy) from error
    content = arrow.table(table(arrays))
    if origin is not None:
        content = content.replace_schema_metadata({"ftbias": as_text(origin)})
    write_atomic(path, lambda file: parquet.write_table(content, file))
