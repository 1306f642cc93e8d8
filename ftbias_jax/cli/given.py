"""What a command is given: its setup, its logs, the files that it may write, and JAX."""

import argparse
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from ftbias_jax.errors import UsageError
from ftbias_jax.fleet.find import expand, inputs
from ftbias_jax.io.atomic import refuse_link
from ftbias_jax.io.write import written
from ftbias_jax.io.write.outputs import SUFFIXES, behind_link, check_outputs, check_writable
from ftbias_jax.setup import Setup, load_setup


def setup_of(arguments: argparse.Namespace, **more: Any) -> Setup:
    """The setup that ``--setup`` names; further arguments are those of ``load_setup``."""
    return load_setup(arguments.setup, allow_outside=arguments.allow_outside, **more)


def start_jax() -> None:
    """Get JAX ready, once it is known that what is asked for can be done: importing it takes half a second."""
    from ftbias_jax.runtime.jax_config import prepare_jax

    prepare_jax()


def logs_of(
    arguments: argparse.Namespace,
    setup: Setup,
    kinds: Mapping[str, str],
    also: Mapping[str, str] | None = None,
    stated: Iterable[str] | None = None,
) -> list[str]:
    """The logs that a command names, once it is sure that its outputs can be written and replace nothing of others.

    Args:
        arguments: of the command; ``in_place``, where it has it, lets the output be the setup.
        setup: of the logs.
        kinds: option -> what it writes (``write.outputs``).
        also: what is written beside that.
        stated: files that are read beside the logs; None = those of the setup.

    Raises:
        UsageError: an argument names no log, a suffix does not fit, or two files are one. OutputError: a folder does
            not exist, or a file is there that no command wrote as the same. LogError: a folder cannot be read.
    """
    outputs = {option: getattr(arguments, option.strip("-")) for option in kinds} | dict(also or {})
    in_place = getattr(arguments, "in_place", False)
    if in_place:
        kinds = {option: kind for option, kind in kinds.items() if option != "--output"}
    for option, path in outputs.items():
        if path:
            check_writable(path, SUFFIXES.get(kinds.get(option, ""), ""), option)
    paths = expand(arguments.logs, setup.log.files)
    if stated is None:
        stated = (setup.description,) if in_place else setup.files
    check_outputs(outputs, (*inputs(paths, setup.log.files), *stated), kinds, arguments.force)
    for path in () if in_place else outputs.values():
        if path:
            refuse_link(path)
    return paths


def only(paths: list[str], result: str) -> str:
    """The one log that a single result can be of.

    Raises:
        UsageError: there are several.
    """
    if len(paths) > 1:
        remedy = "give -o a folder's name, without a suffix"
        raise UsageError(f"{len(paths)} logs for {result}", field="-o", remedy=remedy)
    return paths[0]


def write_answers(answers: Mapping[str | None, Callable[[str], object]]) -> None:
    """Write the answers that are asked for, path -> what writes it, and print their paths; "" or None = not asked."""
    asked = {path: write for path, write in answers.items() if path}
    for path, write in asked.items():
        write(path)
    if asked:
        print(f"wrote {', '.join(name for path in asked for name in written(path))}")


def save_setup(save: Callable[..., object], output: str, arguments: argparse.Namespace, by: str) -> None:
    """Write the setup that a command found, by its method ``save``, over the one that was read if it was told so."""
    save(behind_link(output, arguments.in_place), by="" if arguments.in_place else by)
