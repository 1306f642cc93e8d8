"""Columns of a Parquet file that hold a list in every row, such as the state of a LeRobot data set, entry by entry.

Entry ``i`` of a column is called ``column/i``, or ``column/name`` where ``meta/info.json`` of the data set names it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

MOST_ENTRIES = 1000
"""Of one list: the state of a robot has some dozens."""
MOST_BYTES = 1 << 20
"""Of meta/info.json."""
LEVELS = 4
"""Folders above a file in which the data set's meta may be: data/chunk-000/episode_000000.parquet."""


class Cell(NamedTuple):
    """Where the numbers of a name are."""

    column: str
    """Of the file."""
    entry: int | None = None
    """Of its lists; None = it holds numbers."""


def cells_of(arrow: Any, table: Any, file: str) -> list[tuple[str, Cell]]:
    """The names of all numbers in a row, and where each is; lists whose length is not known are one name."""
    schema, stated = table.schema_arrow, None
    cells: list[tuple[str, Cell]] = []
    for column, kind in zip(map(str, schema.names), schema.types, strict=True):
        if not (arrow.types.is_list(kind) or arrow.types.is_fixed_size_list(kind)):
            cells.append((column, Cell(column)))
            continue
        stated = _features(file) if stated is None else stated
        names = _entry_names(stated.get(column))
        width = kind.list_size if arrow.types.is_fixed_size_list(kind) else len(names)
        if not 0 < width <= MOST_ENTRIES:
            cells.append((column, Cell(column)))
            continue
        names = names if len(names) == width else [str(i) for i in range(width)]
        cells += [(f"{column}/{name}", Cell(column, i)) for i, name in enumerate(names)]
    return cells


def number_type(arrow: Any, kind: Any) -> Any:
    """The type of the numbers in a column of this type."""
    listed = arrow.types.is_list(kind) or arrow.types.is_fixed_size_list(kind)
    return kind.value_type if listed else kind


def values_of(compute: Any, column: Any, entry: int | None) -> Any:
    """The numbers (T,) of a column as an array of pyarrow; an entry of its lists."""
    return (column if entry is None else compute.list_element(column, entry)).cast("float64")


def _features(file: str) -> Mapping[str, Any]:
    """What the data set of a file says of its columns; {} if it belongs to none, or says nothing that can be read."""
    for folder in list(Path(file).absolute().parents)[:LEVELS]:
        try:
            with open(folder / "meta" / "info.json", "rb") as stream:
                found = json.loads(stream.read(MOST_BYTES))
        except (OSError, ValueError, RecursionError):
            continue
        features = found.get("features") if isinstance(found, dict) else None
        return features if isinstance(features, dict) else {}
    return {}


def _entry_names(feature: Any) -> list[str]:
    """Names of a list's entries, or their numbers by its shape; [] if neither is stated."""
    if not isinstance(feature, dict):
        return []
    names, shape = feature.get("names"), feature.get("shape")
    if isinstance(names, dict) and len(names) == 1:  # {"motors": [...]}
        (names,) = names.values()
    if isinstance(names, list) and all(isinstance(name, str) for name in names) and len({*names}) == len(names):
        return names[:MOST_ENTRIES]
    match shape:
        case [int(width)] if 0 < width <= MOST_ENTRIES:
            return [str(i) for i in range(width)]
    return []
