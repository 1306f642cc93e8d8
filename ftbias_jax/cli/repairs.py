"""Warnings: what was mended or left out of logs, and what is wrong with their setup."""

from __future__ import annotations

import sys
from collections.abc import Iterable

from ftbias_jax.errors import printable
from ftbias_jax.io.log import Repairs


def warn(text: str) -> None:
    """Print a warning on standard error, where errors begin with the name of the program."""
    print(printable(f"warning: {text}"), file=sys.stderr, flush=True)


def tell_mistake(path: str, line: str) -> None:
    """Print on standard error what is wrong with the setup of a log.

    Args:
        path: of the log.
        line: what ``Check.lines`` gives.
    """
    warn(f"{path}: {line}")


def tell_repairs(logs: Iterable[tuple[str, Repairs]]) -> int:
    """Print the repairs of every log on standard error; returns the exit code, 3 if samples were lost, else 0.

    Args:
        logs: path of each, and its repairs.
    """
    code = 0
    for path, repairs in logs:
        for repair in repairs:
            warn(f"{path}: {repair.what}")
            code = 3 if repair.lost else code
    return code
