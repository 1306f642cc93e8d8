"""Table beside a manifest, for pandas, Polars or DuckDB: one row per log, one column per number."""

import importlib
import importlib.util
import json
from collections.abc import Mapping, Sequence
from typing import Any

from ftbias_jax.fleet.entry import VECTORS, Entry, Settings
from ftbias_jax.io.atomic import write_atomic
from ftbias_jax.types import AXES


def columns(entries: Sequence[Entry], settings: Mapping[str, Settings]) -> dict[str, list[Any]]:
    """Columns by name, one row per entry; (6,) values have a column per axis, lists of strings are joined by ``; ``."""
    rows = [_row(entry, settings.get(entry.settings)) for entry in entries]
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: [row.get(name) for row in rows] for name in names}


def save_table(path: str, entries: Sequence[Entry], settings: Mapping[str, Settings]) -> bool:
    """Write the table as Parquet, completely or not at all; returns False without pyarrow (extra ``parquet``).

    Raises:
        OutputError: the file cannot be written.
    """
    if importlib.util.find_spec("pyarrow") is None:
        return False
    arrow, parquet = importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
    table = arrow.table(columns(entries, settings))
    write_atomic(path, lambda file: parquet.write_table(table, file))
    return True


def _row(entry: Entry, settings: Settings | None) -> dict[str, Any]:
    row: dict[str, Any] = {**entry._asdict(), "repairs": "; ".join(entry.repairs), "files": "; ".join(entry.files)}
    state, quality, sums = (row.pop(name) for name in ("state", "quality", "sums"))
    row["output_sha256"] = sums.get(entry.output, "")
    row |= {f"log_{name}": value for name, value in state._asdict().items()}
    if settings is not None:
        settings_row = {
            name: getattr(settings, name) for name in ("robot", "sensor", "setup", "setup_sha256", "version")
        }
        row |= settings_row | {"choices": json.dumps(settings.choices, sort_keys=True)}
    for name, value in quality.items():
        if isinstance(value, list) and VECTORS.get(name) == len(AXES):
            numbers = {f"{name}_{axis}": number for axis, number in zip(AXES, value, strict=True)}
        else:
            numbers = {name: "; ".join(map(str, value)) if isinstance(value, list) else value}
        for column, number in numbers.items():  # a column has one type
            row.setdefault(column, float(number) if isinstance(number, int) else number)
    return {_utf8(name): _utf8(value) if isinstance(value, str) else value for name, value in row.items()}


def _utf8(text: str) -> str:
    r"""Text that a table can hold; bytes of a file's name that are not UTF-8 are written as ``\udcXX``."""
    return text.encode("utf-8", "backslashreplace").decode()
