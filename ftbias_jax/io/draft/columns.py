"""What the names of a table's columns put into a setup: [log.columns], units and axes; and what is left to choose."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ftbias_jax.io.draft.table import Table, likeliest
from ftbias_jax.io.tables.headers import Match, matches
from ftbias_jax.setup.keys.toml_text import Known

QUANTITIES = ("time", "position", "velocity", "wrench", "temperature")
"""Keys of [log.columns]."""
MOST_LISTED = 60
"""Columns to choose from."""


def stated_columns(table: Table, joints: Sequence[str] | None = None) -> dict[str, Known]:
    """Keys of a setup that the names of columns give: those of [log.columns] that are not the usual ones, and units.

    The names of the joints give the order of the columns; None = as the header has them.
    """
    keys: dict[str, Known] = {}
    for quantity in (*QUANTITIES, "gyroscope", "accelerometer", "place"):
        candidates = _candidates(quantity, table, joints)
        match = likeliest(candidates)
        if match is None:
            continue
        for key, value in match.facts.items():
            keys[key] = Known(value, f"by the name of the column {match.names[0]}")
        if quantity in QUANTITIES and not match.native:
            if table.orientation and quantity in ("position", "velocity"):
                continue  # they are made of a pose and an IMU, whose columns the reader finds by [sensor_pose]
            names = match.names[0] if quantity in ("time", "temperature") else list(match.names)
            keys[f"log.columns.{quantity}"] = Known(names, _remark(match, candidates, joints))
    return keys


def left_to_choose(tables: Sequence[Table], rate: float | None = None) -> dict[str, Known]:
    """Keys of [log.columns] without a value, for what no table shows by its names, with the columns to choose from.

    With a rate, Hz, that somebody states, no stamps are missed.
    """
    tables_of_columns = [table for table in tables if table.header]
    found = {
        "time": rate is not None or all("time" in table.found for table in tables_of_columns),
        "position": any(table.joints or table.orientation for table in tables),
        "wrench": any(table.wrench for table in tables),
    }
    others = [name for table in tables for name in table.others]
    listed = ", ".join(others[:MOST_LISTED]) + (f" and {len(others) - MOST_LISTED} more" * (len(others) > MOST_LISTED))
    missing = [quantity for quantity, there in found.items() if tables_of_columns and not there]
    return {f"log.columns.{quantity}": Known(None, f"choose from {listed or 'nothing'}") for quantity in missing}


def _candidates(quantity: str, table: Table, joints: Sequence[str] | None) -> list[Match]:
    """Columns that may be a quantity; of joints with other names than the robot's, as many as it has."""
    found = matches(quantity, table.header, joints)
    if found or joints is None or quantity not in ("position", "velocity"):
        return found
    return [match for match in matches(quantity, table.header) if len(match.names) == len(joints)]


def _remark(match: Match, candidates: Sequence[Match], joints: Sequence[str] | None) -> str:
    remarks = []
    if match.joints and joints is not None and tuple(joints) != match.joints:
        remarks.append("in the order of the header: check it")
    if others := ", ".join(f"{other.names[0]} ..." for other in candidates if other is not match):
        remarks.append(f"also there: {others}")
    return "; ".join(remarks)


def nested(keys: dict[str, Known]) -> dict[str, Any]:
    """The same as tables of a setup."""
    tables: dict[str, Any] = {}
    for key, known in keys.items():
        *sections, last = key.split(".")
        table = tables
        for section in sections:
            table = table.setdefault(section, {})
        table[last] = known.value
    return tables
