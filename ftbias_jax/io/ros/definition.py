"""Definitions of messages as recordings bring them: the text of .msg files, one type after the other.

The first type is that of the message; each that it is made of follows behind a line of = and a line ``MSG: pkg/Type``.
ROS 1 stores this text with each connection, ROS 2 with each schema of an MCAP file, and since Iron in SQLite bags.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

from ftbias_jax.io.ros.messages import MessageError
from ftbias_jax.io.ros.raw import plain_type

MAX_TEXT = 1 << 18
"""Characters; the longest real ones have some ten thousand."""
MAX_DEPTH = 32
"""Of types within types."""
SEQUENCE = -1
"""``Field.length`` of a list that says itself how long it is."""

PRIMITIVES = {
    **{"bool": ("B", 1), "byte": ("B", 1), "char": ("B", 1), "octet": ("B", 1), "int8": ("b", 1), "uint8": ("B", 1)},
    **{"int16": ("h", 2), "uint16": ("H", 2), "int32": ("i", 4), "uint32": ("I", 4)},
    **{"int64": ("q", 8), "uint64": ("Q", 8), "float32": ("f", 4), "float64": ("d", 8)},
}
"""Type -> letter of struct, and bytes."""
TEXTS = ("string", "wstring")
HEADER = "std_msgs/Header"
_CLOCK = {"time": "builtin_interfaces/Time", "duration": "builtin_interfaces/Duration"}

_SEPARATOR = re.compile(r"^={20,}[ \t]*\r?$", re.MULTILINE)
_TITLE = re.compile(r"\s*(?:MSG|IDL):[ \t]*([\w/]+)[ \t]*\r?\n?")
_FIELD = re.compile(
    r"(?P<type>[A-Za-z][\w/]*)(?:<=\d{1,9})?(?P<list>\[(?:<=)?(?P<count>\d{0,9})\])?[ \t]+"
    r"(?P<name>[A-Za-z]\w*)[ \t]*(?P<rest>.*)"
)


class Field(NamedTuple):
    """One field of a type."""

    name: str
    type: str
    """A primitive type, text, or the plain name of another type."""
    length: int | None = None
    """Of an array; SEQUENCE = a list; None = one value."""


Types = Mapping[str, tuple[Field, ...]]
"""Plain name -> fields."""


_HEADER = (Field("stamp", _CLOCK["time"]), Field("frame_id", "string"))


def split_definition(text: str, root: str) -> dict[str, str]:
    """Plain name -> text of every type."""
    if len(text) > MAX_TEXT:
        raise MessageError(f"has a definition of {len(text)} characters")
    found: dict[str, str] = {}
    for part in _SEPARATOR.split(text):
        title = _TITLE.match(part)
        if title is None and found:
            raise MessageError("has a definition in which a type has no name")
        if title is not None or part.strip():
            found[plain_type(title[1]) if title else root] = part[title.end() :] if title else part
    return found


def parse_msg(text: str, root: str, ros1: bool) -> Types:
    """The types of a definition in the language of .msg files."""
    types = {}
    for name, part in split_definition(text, root).items():
        fields = []
        for line in part.splitlines():
            line = line.partition("#")[0].strip()
            found = _FIELD.fullmatch(line)
            if found is None and line and "=" not in line:
                raise MessageError(f"has a definition with the line {line[:60]!r}")
            if found is not None and not found["rest"].startswith("="):  # constants take no room
                count = None if found["list"] is None else int(found["count"] or SEQUENCE)
                bounded = found["list"] is not None and "<" in found["list"]
                fields.append(Field(found["name"], _full(found["type"], name), SEQUENCE if bounded else count))
        types[name] = tuple(fields)
    return with_common(types, ros1)


def with_common(types: Mapping[str, tuple[Field, ...]], ros1: bool) -> Types:
    """The types with those that definitions may leave out; ROS 2 gives a type without fields one byte."""
    whole, part = ("uint32", "uint32") if ros1 else ("int32", "uint32")
    common = {
        _CLOCK["time"]: (Field("sec", whole), Field("nanosec", part)),
        _CLOCK["duration"]: (Field("sec", "int32"), Field("nanosec", "int32" if ros1 else part)),
        HEADER: (Field("seq", "uint32"), *_HEADER) if ros1 else _HEADER,
    }
    given = {name: fields or (() if ros1 else (Field("_", "uint8"),)) for name, fields in types.items()}
    return common | given


def smallest(types: Types, name: str, known: dict[str, int] | None = None, depth: int = 0) -> dict[str, int]:
    """The least bytes that a type and all that it is made of take, by name; types within themselves are refused."""
    known = {} if known is None else known
    if name in known:
        return known
    if depth > MAX_DEPTH:
        raise MessageError("has a definition with types within types without end")
    if name not in types:
        raise MessageError(f"has a definition that lacks the type {name[:80]!r}")
    least = 0
    for field in types[name]:
        if field.type not in PRIMITIVES and field.type not in TEXTS:
            smallest(types, field.type, known, depth + 1)
        one = PRIMITIVES[field.type][1] if field.type in PRIMITIVES else known.get(field.type, 4)
        least += 4 if field.length == SEQUENCE else one * (1 if field.length is None else field.length)
    known[name] = least
    return known


def _full(kind: str, within: str) -> str:
    """The plain name of a type; one without a package is of the package of the type that it stands in."""
    if kind in PRIMITIVES or kind in TEXTS:
        return kind
    if kind in _CLOCK:
        return _CLOCK[kind]
    if kind == "Header":
        return HEADER
    return plain_type(kind) if "/" in kind else f"{within.partition('/')[0]}/{kind}"
