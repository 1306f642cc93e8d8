"""Results as tables, one row per wrench sample, one column per number: Parquet, and CSV with metadata beside it.

"Metadata Vocabulary for Tabular Data" (W3C Recommendation, 2015) names the metadata file NAME.csv-metadata.json.
Comments in the CSV itself would be rows to spreadsheets, PlotJuggler and ``pandas.read_csv``.
"""

import os
from collections.abc import Mapping
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from ftbias_jax.io.atomic import write_atomic, write_json
from ftbias_jax.io.budget import need
from ftbias_jax.io.write.fields import FIELDS, unit_of
from ftbias_jax.io.write.selection import About, description, texts_of
from ftbias_jax.types import AXES, Array

JOINT_ARRAYS = ("q", "dq", "ddq", "ddq_std")
"""Arrays with one column per joint; all others of two dimensions have one column per axis of the wrench."""
DIGITS = {"f4": "%.9g", "f8": "%.17g"}
"""Type -> format with all its significant digits."""
DATATYPES = {"f4": "float", "f8": "double", "b1": "integer"}


class Column(NamedTuple):
    """One column of a table."""

    values: Array
    """(T,) values."""
    unit: str
    """"" = not known."""
    meaning: str


def table(arrays: Mapping[str, Array]) -> dict[str, Column]:
    """The columns of a result by name: ``t``, ``bias_fx``, ``q0``; a scalar is repeated in every row.

    The arrays are () or (T,) or (T, k) each; one of them is t (T,).
    """
    length = len(arrays["t"])
    columns: dict[str, Column] = {}
    for name, values in arrays.items():
        values, meaning = np.asarray(values), FIELDS[name].meaning if name in FIELDS else ""
        if values.ndim == 0:
            columns[name] = Column(np.full(length, values), unit_of(name), meaning)
        elif values.shape == (length,):
            columns[name] = Column(values, unit_of(name), meaning)
        elif values.ndim == 2 and len(values) == length and (name in JOINT_ARRAYS or values.shape[1] == len(AXES)):
            of_joints = name in JOINT_ARRAYS
            for i, column in enumerate(values.T):
                label, unit = (f"{name}{i}", unit_of(name)) if of_joints else (f"{name}_{AXES[i]}", unit_of(name, i))
                columns[label] = Column(column, unit, f"{meaning}, joint {i}" if of_joints else f"{meaning}, {AXES[i]}")
        else:
            raise ValueError(f"{name} has shape {values.shape} in a result of {length} samples")
    return columns


def save_parquet(path: str | os.PathLike[str], arrays: Mapping[str, Array], about: About) -> None:
    """Write a Parquet file that pandas, Polars and DuckDB read, with the columns of ``table``.

    ``about`` is stored in the metadata of the schema under ``ftbias`` (provenance) and ``ftbias_about``; every column
    has ``unit`` and ``description`` in its own.
    """
    arrow, parquet = (need(name, "parquet", path, writes=True) for name in ("pyarrow", "pyarrow.parquet"))
    columns = table(arrays)
    made = {name: arrow.array(column.values) for name, column in columns.items()}
    fields = [
        arrow.field(name, values.type, metadata={"unit": columns[name].unit, "description": columns[name].meaning})
        for name, values in made.items()
    ]
    names = {"about": "ftbias_about", "provenance": "ftbias"}
    words = {names[name]: text for name, text in texts_of(arrays, about).items()}
    content = arrow.table(list(made.values()), schema=arrow.schema(fields, metadata=words))
    # Numbers hardly repeat, but their first bytes do: split by bytes, a file is half as large and written faster.
    floats = [name for name, column in columns.items() if column.values.dtype.kind == "f"]
    encoding = {"use_dictionary": sorted(columns.keys() - floats), "use_byte_stream_split": floats}
    write_atomic(path, lambda file: parquet.write_table(content, file, compression="zstd", **encoding))


def companion(path: str | os.PathLike[str]) -> str:
    """Path of the metadata file of a CSV file."""
    return f"{os.fspath(path)}-metadata.json"


def save_csv(path: str | os.PathLike[str], arrays: Mapping[str, Array], about: About) -> None:
    """Write a header line and one line per sample, with all digits of a number; then the metadata file beside it."""
    columns = table(arrays)
    rows = np.column_stack([column.values for column in columns.values()])
    digits = [DIGITS.get(column.values.dtype.str[1:], "%d") for column in columns.values()]

    def write(file: BinaryIO) -> None:
        np.savetxt(file, rows, digits, ",", header=",".join(columns), comments="")

    write_atomic(path, write)
    write_json(companion(path), metadata(os.path.basename(path), columns, arrays, about))


def metadata(url: str, columns: Mapping[str, Column], arrays: Mapping[str, Array], about: About) -> dict[str, Any]:
    """The metadata of a CSV file."""
    return {
        "@context": "http://www.w3.org/ns/csvw",
        "url": url,
        "dialect": {"delimiter": ",", "header": True},
        "tableSchema": {
            "columns": [
                {
                    "titles": name,
                    "datatype": DATATYPES.get(column.values.dtype.str[1:], "double"),
                    "schema:unitText": column.unit,
                    "dc:description": column.meaning,
                }
                for name, column in columns.items()
            ]
        },
        "notes": [{"about": description(arrays, about), "provenance": about.origin}],
    }
