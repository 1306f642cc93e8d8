"""Where results may be written: never over an input, over one another, or over what this program did not write."""

import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType

from ftbias_jax.errors import OutputError, UsageError
from ftbias_jax.files import no_regular_file
from ftbias_jax.io.write.ours import kind_of

NO_KINDS: Mapping[str, str] = MappingProxyType({})
Place = str | os.PathLike[str]


def check_outputs(
    outputs: Mapping[str, Place | None],
    inputs: Iterable[Place | None],
    kinds: Mapping[str, str] = NO_KINDS,
    force: bool = False,
) -> None:
    """Refuse outputs that are an input or another output, under whatever name, or somebody else's file.

    Files are compared by their inodes, so that symbolic and hard links are seen through; those that are not there yet
    by where they would be. An input that is a folder, a bag, stands for every file right in it.

    Args:
        outputs: what names the file on the command line, such as ``-o`` -> the file; None or "" = not asked for.
        inputs: files and folders that are read; None or "" = none.
        kinds: option -> what is written (``write.ours``): a file that is there is replaced only if it is one of these.
        force: replace files of any kind, but no inputs.
    """
    taken = {_identity(file): f"the input {os.fspath(file)!r}" for name in inputs if name for file in _files_of(name)}
    for option, output in outputs.items():
        if output:
            place = _identity(output)
            if place in taken:
                message = f"{os.fspath(output)!r} is the same file as {taken[place]}"
                raise UsageError(message, field=option, remedy="give every result a name of its own")
            taken[place] = f"{os.fspath(output)!r} of {option}"
            if kinds.get(option) and not force:
                check_replaceable(output, kinds[option])


def check_replaceable(output: Place, kind: str) -> None:
    """Refuse to replace a file that this program did not write as the same kind of output."""
    if os.path.isfile(output) and (there := kind_of(output)) != kind:
        what = f"is {there}, not {kind}" if there else f"is not {kind} of ftbias"
        remedy = "name another file, or add --force to replace it"
        raise OutputError(f"is there already, and {what}", file=output, remedy=remedy)


def check_writable(output: Place, suffix: str = "", option: str = "--output") -> None:
    """Refuse an output that cannot be written before minutes are spent on computing it."""
    if not os.fspath(output).endswith(suffix):
        raise UsageError(f"cannot write {os.fspath(output)!r}", field=option, remedy=f"end the name in {suffix}")
    if not Path(output).absolute().parent.is_dir():
        raise OutputError("the folder does not exist", file=output, remedy="create it, or name another")
    with suppress(OSError):  # not there yet
        if kind := no_regular_file(output):
            raise OutputError(kind, file=output, remedy="give the path of a file to write")


def output_of_setup(output: str | None, setup: str, in_place: bool) -> str:
    """Where a command writes the setup that it changes.

    ``output`` is that of ``-o``; None = not given.

    Raises:
        UsageError: there is no output, or it is not the setup though the setup shall be replaced.
        OutputError: its folder does not exist.
    """
    if output is None and not in_place:
        remedy = "add -o OUT.toml, or --in-place to replace the setup itself"
        raise UsageError("needs the name of the setup to write", field="--output", remedy=remedy)
    written = output or setup
    if not in_place and _identity(written) == _identity(setup):
        remedy = "give the result a name of its own, or add --in-place to replace the setup"
        raise UsageError(f"{written!r} is the same file as the input {setup!r}", field="--output", remedy=remedy)
    if in_place and _identity(written) != _identity(setup):
        message = f"replaces {setup!r}, but -o names {written!r}"
        raise UsageError(message, field="--in-place", remedy="leave out one of the two")
    check_writable(written, ".toml")
    return written


def behind_link(output: Place, in_place: bool) -> str:
    """Where to write: what a link leads to for a setup that is replaced in place, which is the one that was read."""
    return os.path.realpath(output) if in_place else os.fspath(output)


def _identity(path: Place) -> tuple[object, ...]:
    """The same for all names of one file."""
    resolved = os.path.realpath(path)
    try:
        status = os.stat(resolved)
    except OSError:  # not there yet; its folder was resolved
        return (resolved,)
    return status.st_dev, status.st_ino


def _files_of(path: Place) -> Iterable[Place]:
    """The path itself, and the files in it if it is a folder; not those below, which may be a whole disk."""
    yield path
    with suppress(OSError), os.scandir(path) as entries:
        yield from (entry.path for entry in entries if not entry.is_dir())


def refuse_existing(path: str) -> None:
    """A setup that somebody has worked on is not replaced by a draft."""
    if os.path.lexists(path):
        raise OutputError("is there already", file=path, remedy="name another file, or remove it")
