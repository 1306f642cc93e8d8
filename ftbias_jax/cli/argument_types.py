"""Kinds of values that options of the command line take: text -> value, or what it must be instead."""

from __future__ import annotations

import argparse
from argparse import ArgumentTypeError
from typing import TypeAlias

from ftbias_jax.errors import UsageError

Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"
"""What commands are added to."""
LOGS = "logs of the same robot, sensor and tool; folders to search, or patterns in quotes"
"""Help of arguments that ``fleet.find.expand`` takes."""


def add_unchecked(parser: argparse.ArgumentParser) -> None:
    """The option of the commands that look first whether a setup can be right."""
    parser.add_argument(
        "--unchecked", action="store_true", help="do not look first whether the setup can be right (ftbias check)"
    )


def add_outside(parser: argparse.ArgumentParser) -> None:
    """The user's word for what a setup alone must not do."""
    parser.add_argument(
        "--allow-outside",
        action="store_true",
        help="let [log.files] of the setup name addresses, and files outside of the log's folder",
    )


def add_force(parser: argparse.ArgumentParser) -> None:
    """The user's word for replacing files that no command wrote."""
    parser.add_argument(
        "--force", action="store_true", help="replace files that ftbias did not write as the same kind of output"
    )


def count(text: str) -> int:
    """Of logs or processes."""
    return _whole(text, 1, 100_000)


def restarts(text: str) -> int:
    """Further starts of a fit."""
    return _whole(text, 0, 1024)


def seed(text: str) -> int:
    """Of random numbers."""
    return _whole(text, 0, 2**32 - 1)


def _whole(text: str, least: int, most: int) -> int:
    if not text.isdecimal() or not least <= int(text) <= most:
        raise ArgumentTypeError(f"must be a whole number from {least} to {most}, not {text!r}")
    return int(text)


def positive(text: str) -> float:
    """A finite number above 0."""
    value = _number(text)
    if not 0 < value < float("inf"):
        raise ArgumentTypeError(f"must be a positive number, not {text!r}")
    return value


def numbers(text: str) -> tuple[float, ...]:
    """Positive numbers, by commas."""
    return tuple(positive(number) for number in text.split(","))


def share(text: str) -> float:
    """A share of a log that leaves some of it."""
    value = _number(text)
    if not 0 <= value <= 0.9:
        raise ArgumentTypeError(f"must be a share from 0 to 0.9, not {text!r}")
    return value


def gate(text: str) -> float:
    """Standard deviations."""
    value = positive(text)
    if value < 1:
        raise ArgumentTypeError(f"must be 1 or more standard deviations, not {text!r}")
    return value


def fields(text: str) -> tuple[str, ...]:
    """Names of a result's arrays, by commas."""
    from ftbias_jax.io.write.selection import check_fields

    names = tuple(name.strip() for name in text.split(",") if name.strip())
    if not names:
        raise ArgumentTypeError("names no field")
    try:
        check_fields(names)
    except UsageError as error:
        raise ArgumentTypeError(f"{error.message} ({error.remedy})") from error
    return names


def _number(text: str) -> float:
    """NaN, which no comparison accepts, if it is none."""
    try:
        return float(text)
    except ValueError:
        return float("nan")


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


def add_archive(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """The options of commands that work on many logs into a folder; returns their group."""
    group = parser.add_argument_group("for a folder")
    group.add_argument("--jobs", type=count, default=1, metavar="N", help="logs at a time (%(default)s)")
    group.add_argument(
        "--shard", type=shard, default=(1, 1), metavar="I/N", help="work on the I-th of N shares only, 1/N to N/N"
    )
    group.add_argument(
        "--verify", action="store_true", help="read results that are done, and make those again that have changed"
    )
    return group


def add_effects(parser: argparse.ArgumentParser) -> None:
    """The option for effects that the caller brings."""
    parser.add_argument(
        "--effects",
        dest="own_effects",
        action="append",
        default=[],
        metavar="FILE.py",
        help="Python file that defines effects of your own, which is run; or the name of an installed package's; may "
        "be repeated",
    )
