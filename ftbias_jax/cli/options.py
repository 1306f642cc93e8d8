"""Build the parsers of commands from the table of all options, commands.toml; converters of option values."""

from __future__ import annotations

import argparse
import math
import sys
import tomllib
from argparse import ArgumentTypeError
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

COMMANDS: dict[str, Any] = tomllib.loads(Path(__file__).with_name("commands.toml").read_text(encoding="utf-8"))
"""Command -> its texts in ``ftbias --help`` and in its own ``--help``, and its options."""
SHARED: dict[str, Any] = COMMANDS.pop("shared")
"""Options and argument groups that several commands share."""


def _whole(least: int, most: int) -> Callable[[str], int]:
    def read(text: str) -> int:
        if not text.isdecimal() or not least <= int(text) <= most:
            raise ArgumentTypeError(f"must be a whole number from {least} to {most}, not {text!r}")
        return int(text)

    return read


def _number(least: float, most: float, what: str) -> Callable[[str], float]:
    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float("nan")  # fails every comparison
        if not least <= value <= most:
            raise ArgumentTypeError(f"must be {what}, not {text!r}")
        return value

    return read


count, restarts, seed = _whole(1, 100_000), _whole(0, 1024), _whole(0, 2**32 - 1)
"""Converters of a number of logs or processes, of a number of restarts of a fit, and of a random seed."""
positive = _number(math.ulp(0.0), sys.float_info.max, "a positive number")
share = _number(0, 0.9, "a share from 0 to 0.9")
"""Converter of a share of a log or of a limit; at most 0.9, so that some of it is left."""
gate = _number(1, sys.float_info.max, "1 or more standard deviations")


def fields(text: str) -> tuple[str, ...]:
    """Comma-separated names of a result's arrays -> tuple of names."""
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    if not names:
        raise ArgumentTypeError("names no field")
    return names


def shard(text: str) -> tuple[int, int]:
    """I/N -> (I, N)."""
    index, _, count = text.partition("/")
    if not (index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count)):
        raise ArgumentTypeError(f"must be I/N with I from 1 to N, not {text!r}")
    return int(index), int(count)


def process(text: str) -> tuple[str, int, int]:
    """HOST:PORT,N,I -> (HOST:PORT, N, I)."""
    coordinator, *numbers = text.split(",")
    if ":" in coordinator and len(numbers) == 2 and all(x.isdecimal() for x in numbers):
        count, index = map(int, numbers)
        if index < count:
            return coordinator, count, index
    raise ArgumentTypeError(f"must be HOST:PORT,N,I with I from 0 to N - 1, not {text!r}")


KINDS: dict[str, Callable[[str], Any]] = {
    **{"count": count, "restarts": restarts, "seed": seed, "positive": positive, "share": share, "gate": gate},
    **{"float": float, "fields": fields, "shard": shard, "process": process},
}
"""Name in commands.toml -> converter of an option's text."""


def add_command(commands: argparse._SubParsersAction[argparse.ArgumentParser], name: str) -> None:
    """Add the parser of one command to the subparsers of the command line."""
    stated = COMMANDS[name]
    words = {what: stated.get(what) for what in ("help", "description", "epilog")}
    parser = commands.add_parser(name, **words)
    _add_options(parser, stated["options"])
    for title, group in stated.get("groups", {}).items():
        options = SHARED["groups"].get(title, {}) | group
        apart = parser.add_argument_group(title, options.pop("description", None))
        _add_options(apart, options, options.pop("either", "").split())
    parser.set_defaults(where=stated.get("where", name))


def _add_options(parser: argparse._ActionsContainer, options: Mapping[str, Any], either: Sequence[str] = ()) -> None:
    """Add options to a parser or an argument group; those that ``either`` names are mutually exclusive."""
    exclusive = parser.add_mutually_exclusive_group() if either else parser
    for name, stated in options.items():
        given = SHARED["options"][name] if stated is True else stated
        (exclusive if name in either else parser).add_argument(*name.split(), **_as_argparse_takes_it(given))


def _as_argparse_takes_it(stated: str | Mapping[str, Any]) -> dict[str, Any]:
    if isinstance(stated, str):
        return {"action": "store_true", "help": stated}
    read: dict[str, Callable[[Any], Any]] = {"type": KINDS.__getitem__, "choices": str.split, "metavar": _metavar}
    return {word: read[word](value) if word in read else value for word, value in stated.items()}


def _metavar(value: str | list[str]) -> str | tuple[str, ...]:
    return tuple(value) if isinstance(value, list) else value
