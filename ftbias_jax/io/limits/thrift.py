"""Structs of Thrift's compact protocol, as Parquet has them in its footer and before every page.

pyarrow ends the process where some of these are damaged and it is asked for a column's sizes, so they are read here.
"""

from __future__ import annotations

from typing import Any

MAX_DEPTH = 16
TRUE, FALSE, BYTE, I16, I32, I64, DOUBLE, BINARY, LIST, SET, MAP, STRUCT = range(1, 13)
"""Types of the compact protocol."""


def struct_at(data: bytes, at: int = 0, depth: int = 0) -> tuple[dict[int, Any], int]:
    """The fields of the struct that begins at a byte, by their numbers, and the byte at which it ends.

    Integers are int, texts bytes, lists lists, structs dictionaries; numbers of other types are left out.
    """
    fields: dict[int, Any] = {}
    field = 0
    while True:
        step, kind = data[at] >> 4, data[at] & 15
        at += 1
        if kind == 0:
            return fields, at
        if step:
            field += step
        else:
            number, at = _varint(data, at)
            field = _signed(number)
        if kind not in (TRUE, FALSE):  # a field of truth has its value in its type
            fields[field], at = _value(data, at, kind, depth + 1)


def _value(data: bytes, at: int, kind: int, depth: int) -> tuple[Any, int]:
    """A value of a type, and where it ends."""
    if depth > MAX_DEPTH:
        raise ValueError("too deep")
    if kind in (I16, I32, I64):
        value, at = _varint(data, at)
        return _signed(value), at
    if kind in (TRUE, FALSE, BYTE, DOUBLE):
        return None, at + (8 if kind == DOUBLE else 1)
    if kind == BINARY:
        length, at = _varint(data, at)
        if at + length > len(data):
            raise ValueError("reaches out of its struct")
        return data[at : at + length], at + length
    if kind == STRUCT:
        return struct_at(data, at, depth)
    if kind in (LIST, SET):
        return _list(data, at, depth)
    raise ValueError("unknown type")  # Parquet has no maps


def _list(data: bytes, at: int, depth: int) -> tuple[list[Any], int]:
    count, kind = data[at] >> 4, data[at] & 15
    at += 1
    if count == 15:
        count, at = _varint(data, at)
    if count > len(data) - at:  # every value takes a byte at least
        raise ValueError("longer than its struct")
    values = []
    for _ in range(count):
        value, at = _value(data, at, kind, depth)
        values.append(value)
    return values, at


def _varint(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = data[at]
        at += 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, at
        shift += 7
        if shift > 63:
            raise ValueError("too long")


def _signed(value: int) -> int:
    """Of zigzag: 0, -1, 1, -2, 2 are 0, 1, 2, 3, 4."""
    return (value >> 1) ^ -(value & 1)
