"""Results as CSV, with the metadata of the W3C's standard for CSV beside them, so that the table stays a plain one.

"Metadata Vocabulary for Tabular Data" (W3C Recommendation, 2015) names that file NAME.csv-metadata.json. Comments in
the CSV itself would be rows to spreadsheets, PlotJuggler and ``pandas.read_csv``.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any, BinaryIO

import numpy as np

from ftbias_jax.io.atomic import write_atomic, write_json
from ftbias_jax.io.write.about import About, description
from ftbias_jax.io.write.table import Column, table
from ftbias_jax.types import Array

DIGITS = {"f4": "%.9g", "f8": "%.17g"}
"""All that a number of this type has."""
DATATYPES = {"f4": "float", "f8": "double", "b1": "integer"}


def companion(path: str | os.PathLike[str]) -> str:
    """The file that says what is in a CSV file."""
    return f"{os.fspath(path)}-metadata.json"


def save_csv(path: str | os.PathLike[str], arrays: Mapping[str, Array], about: About | None = None) -> None:
    """Write a header line and a line a sample, with all digits that a number has; then the metadata beside it."""
    columns = table(arrays)
    rows = np.column_stack([column.values for column in columns.values()])
    digits = [DIGITS.get(column.values.dtype.str[1:], "%d") for column in columns.values()]

    def write(file: BinaryIO) -> None:
        np.savetxt(file, rows, digits, ",", header=",".join(columns), comments="")

    write_atomic(path, write)
    write_json(companion(path), metadata(os.path.basename(path), columns, arrays, about or About()))


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
