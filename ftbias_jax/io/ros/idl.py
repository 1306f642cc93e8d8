"""Definitions in OMG's interface description language, which ROS 2 may store instead of .msg files."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterator

from ftbias_jax.io.ros.definition import PRIMITIVES, SEQUENCE, TEXTS, Field, Types, split_definition, with_common
from ftbias_jax.io.ros.messages import MessageError

_TOKEN = re.compile(
    r"""\s+|//[^\n]*|\#[^\n]*|(?P<comment>/\*)  # spaces, comments, #include
    |(?P<text>"(?:\\.|[^"\\])*")|(?P<word>[A-Za-z_][\w:]*|[+-]?[\d.][\w.+-]*)|(?P<mark>.)""",
    re.VERBOSE | re.DOTALL,
)
_NAMES = {
    **{"double": "float64", "float": "float32", "boolean": "bool", "short": "int16", "unsigned short": "uint16"},
    **{"long": "int32", "unsigned long": "uint32", "long long": "int64", "unsigned long long": "uint64"},
}


def parse_idl(text: str, root: str) -> Types:
    """The types of a definition, by plain name."""
    types: dict[str, tuple[Field, ...]] = {}
    for part in split_definition(text, root).values():
        _module(_Tokens(part), types, {}, [])
    return with_common(types, ros1=False)


class _Tokens:
    """Words and marks one after the other, without comments."""

    def __init__(self, text: str) -> None:
        self._left = deque(_words(text))

    def peek(self) -> str:
        """The next one; "" at the end."""
        return self._left[0] if self._left else ""

    def take(self, wanted: str = "") -> str:
        """The next one, which must be there, and be the wanted one; annotations before it are skipped."""
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
        if match["mark"] == '"':  # looking for its end again and again would take forever
            raise MessageError("has a definition with a text that does not end")
        if token := match["text"] or match["word"] or match["mark"]:
            yield token


def _module(
    tokens: _Tokens, types: dict[str, tuple[Field, ...]], aliases: dict[str, Field], path: list[str], depth: int = 0
) -> None:
    """What stands in a module, or in the file: modules, structs, aliases; constants are skipped."""
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
    """One declaration up to its semicolon: fields of one type."""
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
    """A type, and how many of it."""
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
