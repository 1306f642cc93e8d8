"""Inputs and outputs common to the commands: setup, logs, files that may be written, and the start of JAX."""

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
    """Load the setup that ``--setup`` names; further arguments are passed to ``load_setup``."""
    return load_setup(arguments.setup, allow_outside=arguments.allow_outside, **more)


def start_jax() -> None:
    """Import and configure JAX, after all checks of the arguments, because the import takes half a second."""
    from ftbias_jax.runtime.jax_config import prepare_jax

    prepare_jax()


def logs_of(
    arguments: argparse.Namespace,
    setup: Setup,
    kinds: Mapping[str, str],
    also: Mapping[str, str] | None = None,
    stated: Iterable[str] | None = None,
) -> list[str]:
    """Paths of the logs that a command names, after checks that its outputs can be written and overwrite no other file.

    Args:
        arguments: parsed arguments of the command; ``in_place``, if it exists, permits the output to be the setup.
        setup: setup of the logs.
        kinds: option -> kind of its output (``write.outputs``).
        also: further outputs, description -> path.
        stated: files that are read in addition to the logs; None = those of the setup.

    Raises:
        UsageError: an argument names no log, a suffix does not fit, or two files are the same. OutputError: a folder
            does not exist, or an existing file is not of the same kind of output. LogError: a folder cannot be read.
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
    """The only log, for a command that writes a single result.

    Raises:
        UsageError: there are several logs.
    """
    if len(paths) > 1:
        remedy = "give -o a folder's name, without a suffix"
        raise UsageError(f"{len(paths)} logs for {result}", field="-o", remedy=remedy)
    return paths[0]


def write_answers(answers: Mapping[str | None, Callable[[str], object]]) -> None:
    """Write the requested outputs, path -> function that writes it, and print the paths; "" or None = not requested."""
    asked = {path: write for path, write in answers.items() if path}
    for path, write in asked.items():
        write(path)
    if asked:
        print(f"wrote {', '.join(name for path in asked for name in written(path))}")


def save_setup(save: Callable[..., object], output: str, arguments: argparse.Namespace, by: str) -> None:
    """Write a command's setup with its method ``save``, with ``--in-place`` over the setup that was read."""
    save(behind_link(output, arguments.in_place), by="" if arguments.in_place else by)
