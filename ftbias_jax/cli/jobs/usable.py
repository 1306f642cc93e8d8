"""The logs of many that can be used together; the others are left out, and told."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ftbias_jax.check.check_setup import require_right
from ftbias_jax.cli.repairs import warn
from ftbias_jax.errors import FtbiasError, LogError, SetupError
from ftbias_jax.io import read_log
from ftbias_jax.io.log import Log
from ftbias_jax.setup.types import Setup


class Usable(NamedTuple):
    """Logs that can be used."""

    logs: dict[str, Log]
    """By their paths."""
    errors: dict[str, FtbiasError]
    """Why the others cannot, by their paths."""


def read_usable(setup: Setup, paths: Sequence[str], command: str, unchecked: bool) -> Usable:
    """Read logs; leave out those that cannot be read, and those that alone show the setup to be wrong.

    Args:
        setup: of all of them.
        paths: of the logs.
        command: what they are wanted for, as of ``require_right``.
        unchecked: do not look whether the setup can be right.
    """
    logs: dict[str, Log] = {}
    errors: dict[str, FtbiasError] = {}
    for path in paths:
        try:
            logs[path] = read_log(path, setup)
        except LogError as error:
            errors[path] = error
    found = {path: mistaken(setup, [log], command, unchecked) for path, log in logs.items()}
    wrong = {path: error for path, error in found.items() if error is not None}
    if len(wrong) < len(logs):  # otherwise it is the setup that is wrong, not the logs
        logs = {path: log for path, log in logs.items() if path not in wrong}
        errors |= {path: LogError(str(error), file=path) for path, error in wrong.items()}
    return Usable(logs, errors)


def mistaken(setup: Setup, logs: Sequence[Log], command: str, unchecked: bool) -> FtbiasError | None:
    """What ``require_right`` finds wrong with logs and setup; None = nothing."""
    try:
        if logs:
            require_right(setup, logs, command, unchecked)
    except (SetupError, LogError) as error:
        return error
    return None


def tell_left_out(errors: dict[str, FtbiasError], count: int) -> None:
    """Print on standard error which logs are left out.

    Args:
        errors: by the paths of the logs.
        count: of all logs.

    Raises:
        FtbiasError: that of the first log, if none is left.
    """
    if errors and len(errors) == count:
        raise next(iter(errors.values()))
    for error in errors.values():
        warn(f"left out: {error}")
