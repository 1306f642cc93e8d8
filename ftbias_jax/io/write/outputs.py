"""Checks of output paths: results never overwrite an input, one another, or what this program did not write.

The content of a file shows whether this program wrote it, and as what: only these are replaced without ``force``.
"""

import json
import os
import zipfile
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ftbias_jax.errors import LogError, OutputError, UsageError
from ftbias_jax.files import no_regular_file
from ftbias_jax.io.tables.array_files import load_arrays
from ftbias_jax.io.write.fields import SIGN
from ftbias_jax.io.write.table import companion
from ftbias_jax.setup.save import WRITTEN_BY

RESULT, LOG, SETUP, PAGE, FIGURE, EXPORT = "a result", "a log", "a setup", "a page", "a figure", "an export"
DIAGNOSIS, CHECK, SCORE, CALIBRATION, PLAN = "a diagnosis", "a check", "a score", "a calibration", "a plan"
SUFFIXES = {CALIBRATION: ".json", CHECK: ".json", DIAGNOSIS: ".json", PAGE: ".html", PLAN: ".json", SETUP: ".toml"}
"""Kind of output -> required suffix of its file."""
END = 1 << 16
"""Number of bytes that are examined at either end of a file."""
GENERATOR = b'<meta name="generator" content="ftbias_jax'
IN_JSON = {
    DIAGNOSIS: (b'"schema"', b'"verdict"', b'"sentence"'),
    CHECK: (b'"ok"', b'"findings"'),
    CALIBRATION: (b'"kept"', b'"forecast"'),
    SCORE: (b'"versions"', b'"logs"'),
    PLAN: (b'"expected_std"', b'"largest_share"'),
    LOG: (b'"provenance"', b'"effects"'),
}
"""Kind of output -> keys at the beginning of its JSON."""
FOR_OTHERS = (b"by ftbias_jax ", b'"/ftbias/')
"""Text in exports for other programs: their origin, or the topics that layouts show."""
NOT_EXPRESSED = "not_expressed.json"
"""Name of the list that is written beside a simulator's corrected file."""
Place = str | os.PathLike[str]


def check_outputs(
    outputs: Mapping[str, Place | None],
    inputs: Iterable[Place | None],
    kinds: Mapping[str, str] = MappingProxyType({}),
    force: bool = False,
) -> None:
    """Refuse outputs that are an input or another output, under whatever name, or somebody else's file.

    Files are compared by their inodes, which resolves symbolic and hard links; files that do not exist yet by their
    resolved paths. An input that is a folder, a bag, stands for every file directly in it.

    Args:
        outputs: option of the command line, such as ``-o`` -> its file; None or "" = not requested.
        inputs: files and folders that are read; None or "" = none.
        kinds: option -> kind of output, such as RESULT: an existing file is replaced only if it is of this kind.
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
    """Refuse an output that cannot be written, before minutes are spent on computing it."""
    if not os.fspath(output).endswith(suffix):
        raise UsageError(f"cannot write {os.fspath(output)!r}", field=option, remedy=f"end the name in {suffix}")
    if not Path(output).absolute().parent.is_dir():
        raise OutputError("the folder does not exist", file=output, remedy="create it, or name another")
    with suppress(OSError):  # not there yet
        if kind := no_regular_file(output):
            raise OutputError(kind, file=output, remedy="give the path of a file to write")


def output_of_setup(output: str | None, setup: str, in_place: bool) -> str:
    """Path to which a command writes the setup that it changes.

    ``output`` is the value of ``-o``; None = not given.

    Raises:
        UsageError: no output is given, it is the setup without ``in_place``, or another file with ``in_place``.
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
    """Path to write to: the target of a link, which was read, for a setup that is replaced in place."""
    return os.path.realpath(output) if in_place else os.fspath(output)


def refuse_existing(path: str) -> None:
    """Refuse to replace an existing setup, which somebody may have edited, by a draft."""
    if os.path.lexists(path):
        raise OutputError("is there already", file=path, remedy="name another file, or remove it")


def kind_of(path: str | os.PathLike[str]) -> str:
    """Kind of output as which this program wrote a file, such as RESULT; "" = it did not, or nothing shows it."""
    file = os.fspath(path)
    try:
        with open(file, "rb") as stream:
            head = stream.read(END)
            stream.seek(max(os.fstat(stream.fileno()).st_size - END, 0))
            tail = stream.read(END)
    except OSError:
        return ""
    suffix = os.path.splitext(file)[1].lower()
    if suffix == ".toml":
        return SETUP if head.startswith(WRITTEN_BY.encode()) else ""
    if any(words in head + tail for words in FOR_OTHERS) or _is_not_expressed(file, head):
        return EXPORT
    match suffix:
        case ".npz":
            return _of_arrays(file)
        case ".csv":
            return RESULT if _is_ours(companion(file)) else ""
        case ".parquet" | ".mcap":
            return RESULT if b"ftbias" in head + tail else ""
        case ".json":
            return next((kind for kind, words in IN_JSON.items() if all(word in head for word in words)), "")
        case ".html":
            return PAGE if GENERATOR in head else ""
        case ".png" | ".svg" | ".pdf":
            return FIGURE if b"ftbias_jax" in head + tail else ""
    return ""


def _is_not_expressed(file: str, head: bytes) -> bool:
    """Whether a file is the list of what a simulator's file cannot express: it has a name and a form of its own."""
    try:
        found = json.loads(head) if os.path.basename(file) == NOT_EXPRESSED else None
    except ValueError:
        return False
    return isinstance(found, list) and all(isinstance(one, dict) and "why" in one for one in found)


def _identity(path: Place) -> tuple[object, ...]:
    """Key that is the same for all names of one file."""
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


def _is_ours(metadata: str) -> bool:
    try:
        with open(metadata, "rb") as stream:
            return json.dumps(SIGN).encode() in stream.read(END)
    except OSError:
        return False


def _of_arrays(file: str) -> str:
    try:
        if "about.npy" not in zipfile.ZipFile(file).namelist():
            return ""
        about: Any = json.loads(str(load_arrays(file, ("about",))["about"]))
    except (LogError, OSError, zipfile.BadZipFile, KeyError, ValueError, RecursionError):
        return ""
    known = about.keys() if isinstance(about, dict) else ()
    return RESULT if "fields" in known else LOG if "reports" in known else ""
