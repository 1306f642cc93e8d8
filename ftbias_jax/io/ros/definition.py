"""Parsing of the message definitions in recordings: the texts of .msg files, one type after the other, or OMG IDL.

The first type is that of the message; each type that it contains follows a line of = and a line ``MSG: pkg/Type``.
ROS 1 stores this text with each connection; ROS 2 stores it with each schema of an MCAP file and, since Iron, in SQLite
bags, or uses OMG's interface description language (IDL) instead.
"""

import re
from collections import deque
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from ftbias_jax.io.ros.messages import MessageError
from ftbias_jax.io.ros.raw import Definition, plain_type

MAX_TEXT = 1 << 18
"""Characters of a definition; the longest real ones have some ten thousand."""
MAX_DEPTH = 32
"""Maximum nesting depth of types."""
SEQUENCE = -1
"""``Field.length`` of a list whose length is stored in the message."""

PRIMITIVES = {
    **{"bool": ("B", 1), "byte": ("B", 1), "char": ("B", 1), "octet": ("B", 1), "int8": ("b", 1), "uint8": ("B", 1)},
    **{"int16": ("h", 2), "uint16": ("H", 2), "int32": ("i", 4), "uint32": ("I", 4)},
    **{"int64": ("q", 8), "uint64": ("Q", 8), "float32": ("f", 4), "float64": ("d", 8)},
}
"""Type -> format character of ``struct``, and bytes."""
TEXTS = ("string", "wstring")
HEADER = "std_msgs/Header"
_CLOCK = {"time": "builtin_interfaces/Time", "duration": "builtin_interfaces/Duration"}

_SEPARATOR = re.compile(r"^={20,}[ \t]*\r?$", re.MULTILINE)
_TITLE = re.compile(r"\s*(?:MSG|IDL):[ \t]*([\w/]+)[ \t]*\r?\n?")
_FIELD = re.compile(
    r"(?P<type>[A-Za-z][\w/]*)(?:<=\d{1,9})?(?P<list>\[(?:<=)?(?P<count>\d{0,9})\])?[ \t]+"
    r"(?P<name>[A-Za-z]\w*)[ \t]*(?P<rest>.*)"
)
_TOKEN = re.compile(
    r"""\s+|//[^\n]*|\#[^\n]*|(?P<comment>/\*)  # spaces, comments, #include
    |(?P<text>"(?:\\.|[^"\\])*")|(?P<word>[A-Za-z_][\w:]*|[+-]?[\d.][\w.+-]*)|(?P<mark>.)""",
    re.VERBOSE | re.DOTALL,
)
_NAMES = {
    **{"double": "float64", "float": "float32", "boolean": "bool", "short": "int16", "unsigned short": "uint16"},
    **{"long": "int32", "unsigned long": "uint32", "long long": "int64", "unsigned long long": "uint64"},
}


class Field(NamedTuple):
    """One field of a type."""

    name: str
    type: str
    """A primitive type, a string type, or the plain name of another type."""
    length: int | None = None
    """Length of an array; SEQUENCE = a list of variable length; None = one value."""


Types = Mapping[str, tuple[Field, ...]]
"""Plain name of a type -> its fields."""

_HEADER = (Field("stamp", _CLOCK["time"]), Field("frame_id", "string"))


def parse(definition: Definition, root: str, ros1: bool) -> Types:
    """Parse a definition in either language into its types, by plain name."""
    return (
        parse_idl(definition.text, root) if definition.format == "ros2idl" else parse_msg(definition.text, root, ros1)
    )


def split_definition(text: str, root: str) -> dict[str, str]:
    """Split a definition into the text of every type, by plain name."""
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
    """Parse a definition in the language of .msg files into its types, by plain name."""
    types = {}
    for name, part in split_definition(text, root).items():
        fields = []
        for line in part.splitlines():
            line = line.partition("#")[0].strip()
            found = _FIELD.fullmatch(line)
            if found is None and line and "=" not in line:
                raise MessageError(f"has a definition with the line {line[:60]!r}")
            if found is not None and not found["rest"].startswith("="):  # constants are not stored in messages
                count = None if found["list"] is None else int(found["count"] or SEQUENCE)
                bounded = found["list"] is not None and "<" in found["list"]
                fields.append(Field(found["name"], _full(found["type"], name), SEQUENCE if bounded else count))
        types[name] = tuple(fields)
    return with_common(types, ros1)


def with_common(types: Mapping[str, tuple[Field, ...]], ros1: bool) -> Types:
    """Add the types that definitions may omit; ROS 2 gives a type without fields one byte."""
    whole, part = ("uint32", "uint32") if ros1 else ("int32", "uint32")
    common = {
        _CLOCK["time"]: (Field("sec", whole), Field("nanosec", part)),
        _CLOCK["duration"]: (Field("sec", "int32"), Field("nanosec", "int32" if ros1 else part)),
        HEADER: (Field("seq", "uint32"), *_HEADER) if ros1 else _HEADER,
    }
    given = {name: fields or (() if ros1 else (Field("_", "uint8"),)) for name, fields in types.items()}
    return common | given


def smallest(types: Types, name: str, known: dict[str, int] | None = None, depth: int = 0) -> dict[str, int]:
    """Minimum bytes of a type and of all types that it contains, by name; recursive types are refused."""
    known = {} if known is None else known
    if name in known:
        return known
    if depth > MAX_DEPTH:
        raise MessageError("has a recursive definition, or types nested too deeply")
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
    """The plain name of a type; a name without a package refers to the package of the enclosing type."""
    if kind in PRIMITIVES or kind in TEXTS:
        return kind
    if kind in _CLOCK:
        return _CLOCK[kind]
    if kind == "Header":
        return HEADER
    return plain_type(kind) if "/" in kind else f"{within.partition('/')[0]}/{kind}"


def parse_idl(text: str, root: str) -> Types:
    """Parse a definition in IDL into its types, by plain name."""
    types: dict[str, tuple[Field, ...]] = {}
    for part in split_definition(text, root).values():
        _module(_Tokens(part), types, {}, [])
    return with_common(types, ros1=False)


class _Tokens:
    """Tokens of an IDL text in order, without comments."""

    def __init__(self, text: str) -> None:
        self._left = deque(_words(text))

    def peek(self) -> str:
        """The next token, which is not consumed; "" at the end."""
        return self._left[0] if self._left else ""

    def take(self, wanted: str = "") -> str:
        """Consume the next token, which must exist and equal ``wanted`` if given; annotations before it are skipped."""
        token = self._next()
        while token == "@":
            self._next()
            if self.peek() == "(":
                while self._next() != ")":
                    pass
            token = self._next()
        if wanted and token != wanted:
            raise MessageError(f"has a definition with {token[:40]!r} where {wanted!r} should be")
        return token

    def _next(self) -> str:
        if not self._left:
            raise MessageError("has a definition that ends too early")
        return self._left.popleft()


def _words(text: str) -> Iterator[str]:
    position = 0
    while match := _TOKEN.match(text, position):
        position = match.end()
        if match["comment"]:
            end = text.find("*/", position)
            position = len(text) if end < 0 else end + 2
        if match["mark"] == '"':  # repeated searches for its end would take forever
            raise MessageError("has a definition with a text that does not end")
        if token := match["text"] or match["word"] or match["mark"]:
            yield token


def _module(
    tokens: _Tokens, types: dict[str, tuple[Field, ...]], aliases: dict[str, Field], path: list[str], depth: int = 0
) -> None:
    """Parse the content of a module or of the file: modules, structs and typedefs; constants are skipped."""
    if depth > 8:
        raise MessageError("has a definition with modules within modules without end")
    while tokens.peek() not in ("}", ""):
        word = tokens.take()
        if word == "module":
            name = tokens.take()
            tokens.take("{")
            _module(tokens, types, aliases, [*path, name], depth + 1)
            tokens.take("}")
        elif word == "struct":
            name = tokens.take()
            tokens.take("{")
            fields = []
            while tokens.peek() != "}":
                fields += _fields(tokens, aliases, path)
            tokens.take("}")
            kept = [field for field in fields if field.name != "structure_needs_at_least_one_member"]
            types[_plain([*path, name])] = tuple(kept)
        elif word == "typedef":
            aliases |= {field.name: field for field in _fields(tokens, aliases, path)}
            continue
        elif word != ";":
            while tokens.take() != ";":
                pass
            continue
        if tokens.peek() == ";":
            tokens.take()


def _fields(tokens: _Tokens, aliases: dict[str, Field], path: list[str]) -> list[Field]:
    """Parse one declaration up to its semicolon: fields of one type."""
    kind, count = _type(tokens, aliases, path, tokens.take())
    fields, name = [], tokens.take()
    while True:
        own = count
        while tokens.peek() == "[":
            tokens.take()
            if own == SEQUENCE:
                raise MessageError("has a definition with lists of lists")
            size = tokens.take()
            if not size.isdecimal() or len(size) > 9:
                raise MessageError(f"has a definition with an array of {size[:20]!r}")
            own = int(size) if own is None else own * int(size)
            tokens.take("]")
        fields.append(Field(name, kind, own))
        if tokens.take() == ";":
            return fields
        name = tokens.take()


def _type(tokens: _Tokens, aliases: dict[str, Field], path: list[str], word: str) -> tuple[str, int | None]:
    """Parse a type; returns its name and ``Field.length``."""
    if word == "sequence":
        tokens.take("<")
        word = tokens.take()
        kind, inner = (word, SEQUENCE) if word == "sequence" else _type(tokens, aliases, path, word)
        if inner is not None:
            raise MessageError("has a definition with lists of lists")
        if tokens.take() == ",":
            tokens.take()
            tokens.take(">")
        return kind, SEQUENCE
    while word in ("unsigned", "long", "unsigned long") and tokens.peek() in ("long", "short"):
        word = f"{word} {tokens.take()}"
    if word in TEXTS:
        if tokens.peek() == "<":
            for _ in range(3):
                tokens.take()
        return word, None
    if word in aliases:
        return aliases[word].type, aliases[word].length
    word = _NAMES.get(word, word)
    if word in PRIMITIVES:
        return word, None
    return (_plain(word.split("::")) if "::" in word else _plain([*path, word])), None


def _plain(names: list[str]) -> str:
    return "/".join(name for name in names if name not in ("msg", ""))
