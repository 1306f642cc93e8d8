"""What parsers of commands are made of: kinds of values (text -> value, or what it must be), and shared options."""

from __future__ import annotations

import argparse
import math
import sys
from argparse import ArgumentTypeError
from collections.abc import Callable
from typing import Any, NamedTuple

from ftbias_jax.errors import UsageError

Option = Callable[[argparse._ActionsContainer], object]
"""Adds itself to a parser or to a group of one."""


class Command(NamedTuple):
    """What ``ftbias --help`` and a command's own ``--help`` say, and what the command takes."""

    help: str
    description: str
    options: tuple[Option, ...]
    epilog: str | None = None
    where: str = ""
    """MODULE:FUNCTION of ``cli.commands``; "" = ``run`` of the module that has the command's name."""


def option(name: str, metavar: str | tuple[str, ...] | None, text: str, **more: Any) -> Option:
    """An option or a positional argument, as ``add_argument`` takes it."""
    return lambda parser: parser.add_argument(*name.split(), metavar=metavar, help=text, **more)


def flag(name: str, text: str) -> Option:
    """An option without a value."""
    return lambda parser: parser.add_argument(name, action="store_true", help=text)


def choice(name: str, words: str, text: str) -> Option:
    """An option that takes one of some words; the first one unless it is given."""
    return option(name, None, text, choices=words.split(), default=words.split()[0])


def group(title: str, *options: Option, description: str | None = None) -> Option:
    """Options that ``--help`` lists apart."""

    def add(parser: argparse._ActionsContainer) -> None:
        _add_all(parser.add_argument_group(title, description), options)

    return add


def either(*options: Option) -> Option:
    """Options of which one may be given."""
    return lambda parser: _add_all(parser.add_mutually_exclusive_group(), options)


def _add_all(parser: argparse._ActionsContainer, options: tuple[Option, ...]) -> None:
    for add in options:
        add(parser)


def add_command(commands: argparse._SubParsersAction[argparse.ArgumentParser], name: str, command: Command) -> None:
    """Add the parser of a command to those of the whole command line."""
    parser = commands.add_parser(name, help=command.help, description=command.description, epilog=command.epilog)
    _add_all(parser, command.options)
    parser.set_defaults(where=command.where or name)


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
            value = float("nan")  # which no comparison accepts
        if not least <= value <= most:
            raise ArgumentTypeError(f"must be {what}, not {text!r}")
        return value

    return read


count, restarts, seed = _whole(1, 100_000), _whole(0, 1024), _whole(0, 2**32 - 1)
"""Of logs or processes; further starts of a fit; of random numbers."""
positive = _number(math.ulp(0.0), sys.float_info.max, "a positive number")
share = _number(0, 0.9, "a share from 0 to 0.9")
"""Of a log, which leaves some of it."""
gate = _number(1, sys.float_info.max, "1 or more standard deviations")


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


LOGS_OF_ONE = "logs of the same robot, sensor and tool; folders to search, or patterns in quotes"
"""What ``fleet.find.expand`` takes."""
LOGS = option("logs", "LOG", LOGS_OF_ONE, nargs="+")


def setup(text: str = "robot, sensor, tool and noise") -> Option:
    """The setup that a command reads."""
    return option("--setup", "SETUP.toml", text, required=True)


def output(metavar: str, text: str, **more: Any) -> Option:
    """Where a command writes its result."""
    return option("-o --output", metavar, text, **more)


def length(seconds: float, rate: float) -> tuple[Option, Option]:
    """Of a simulated log."""
    return (
        option("--duration", "S", "seconds (%(default)s)", type=positive, default=seconds),
        option("--rate", "HZ", "samples a second (%(default)s)", type=positive, default=rate),
    )


SEED = option("--seed", "N", "of the random numbers (%(default)s)", type=seed, default=0)
IN_PLACE = flag("--in-place", "replace SETUP.toml by the result")
HOLD_OUT = option("--hold-out", "SHARE", "end of every log kept to judge by (%(default)s)", type=share, default=0.25)
UNCHECKED = flag("--unchecked", "do not look first whether the setup can be right (ftbias check)")
OUTSIDE = flag("--allow-outside", "let [log.files] of the setup name addresses, and files outside of the log's folder")
FORCE = flag("--force", "replace files that ftbias did not write as the same kind of output")
OWN_EFFECTS = option(
    "--effects",
    "FILE.py",
    "Python file that defines effects of your own, which is run; or the name of an installed package's; may be "
    "repeated",
    dest="own_effects",
    action="append",
    default=[],
)
FOLDER = (
    option("--jobs", "N", "logs at a time (%(default)s)", type=count, default=1),
    option("--shard", "I/N", "work on the I-th of N shares only, 1/N to N/N", type=shard, default=(1, 1)),
    option("--executor", "NAME", "workers of a cluster do the logs: dask:tcp://HOST:PORT, ray or ray:ADDRESS"),
    flag("--verify", "read results that are done, and make those again that have changed"),
)
"""Of commands that work on many logs into a folder."""
ARCHIVE = group("for a folder", *FOLDER)
