"""The manifest of a folder of results: lines of JSON that are only ever added, one for each log that is done.

A line costs the same for the first log and for the ten thousandth, and a process that is killed in the middle of one
loses that line alone. Of several lines about one result the last one holds. Other lines say what the logs were worked
on with (``settings``, once for each) and that a run began (``run``).
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from ftbias_jax.errors import LogError, OutputError
from ftbias_jax.files import no_regular_file, open_to_append
from ftbias_jax.fleet.entry import DONE, Entry, LogState, Settings, read_entry, read_settings
from ftbias_jax.fleet.place import Place
from ftbias_jax.io.atomic import refuse_link
from ftbias_jax.io.remote import is_url
from ftbias_jax.io.write.provenance import sha256_of

SYNC_SECONDS = 1.0
"""Lines are flushed to disk at least so often; logs done since are done again if the machine loses its power."""
PUBLISH_SECONDS = 5.0
"""The same of lines that go to a bucket; logs done since are done again if the process is killed."""
PUBLISH_SHARE = 0.05
"""Of the time that may be spent on flushing, of which a manifest takes more as it grows: seldomer then."""
LONGEST_LINE = 2**20
"""Bytes; a line of one log has about a thousand."""
DAMAGED = (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError)
"""What is raised over a line that the program does not write."""
MOST_BYTES, MOST_OLD_BYTES = 128 * 2**20, 16 * 2**20
"""Of a manifest, about 120,000 logs, which take 0.6 GB of memory; of one of schema 1, which is read as a whole."""


class Contents(NamedTuple):
    """What the manifests of a folder say."""

    entries: dict[str, Entry]
    """By the paths of results; by those of logs where there is no result."""
    settings: dict[str, Settings]
    """By their keys."""
    damaged: int = 0
    """Lines that could not be read."""


class Manifest:
    """The manifest of one run, open for new lines.

    Args:
        path: of the file, which is made if it is not there.
        publish: called every PUBLISH_SECONDS if the file is a copy of what is elsewhere.

    Raises:
        OutputError: it cannot be written; every method raises it, too.
    """

    def __init__(self, path: str, publish: Callable[[], None] | None = None) -> None:
        self.path, self._publish = path, publish
        self._seldom = PUBLISH_SECONDS if publish else SYNC_SECONDS
        self._next = time.monotonic() + self._seldom
        refuse_link(path)
        with _errors_of(path):
            self._file = open_to_append(path)
            if _ends_in_the_middle(path):
                self._file.write(b"\n")

    def add(self, kind: str, content: Mapping[str, Any]) -> None:
        """Add a line of the kind "log", "settings" or "run": plain numbers, words, lists and dicts."""
        line = json.dumps({kind: content}, allow_nan=False, separators=(",", ":")) + "\n"
        with _errors_of(self.path):
            self._file.write(line.encode())
            self._file.flush()
            # A run whose manifest cannot be written ends before minutes are spent on it.
            started = time.monotonic()
            if kind == "run" or started > self._next:
                (self._publish or partial(os.fsync, self._file.fileno()))()
                now = time.monotonic()
                self._next = now + max(self._seldom, (now - started) / PUBLISH_SHARE)

    def add_entry(self, entry: Entry) -> None:
        """Add what became of a log."""
        self.add("log", {**entry._asdict(), "state": entry.state._asdict()})

    def __enter__(self) -> Manifest:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        # After another failure that one is told.
        with _errors_of(self.path) if error is None else suppress(OSError):
            self._file.close()


@contextmanager
def _errors_of(path: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        remedy = "check that the folder exists, may be written to and has room"
        raise OutputError(f"cannot be written: {error.strerror or error}", file=path, remedy=remedy) from error


def manifest_name(job: str, index: int, count: int) -> str:
    """Every command and every machine writes its own, so that none waits for another."""
    return f"manifest.{job}.jsonl" if count == 1 else f"manifest.{job}.{index}-of-{count}.jsonl"


def read_manifests(folder: str) -> Contents:
    """What the manifests in a folder say.

    Raises:
        LogError: a file is larger than manifests get.
    """
    entries: dict[str, Entry] = {}
    settings: dict[str, Settings] = {}
    damaged = 0
    old, new = (sorted(Path(folder).glob(pattern)) for pattern in ("manifest*.json", "manifest.*.jsonl"))
    for path in (*old, *new):
        read = _read_old if path.suffix == ".json" else read_lines
        for content in read(path):
            if content is None:
                damaged += 1
            elif isinstance(content, Settings):
                settings[content.key] = content
            else:
                place = content.output or content.log
                if place not in entries or content.done >= entries[place].done:
                    entries[place] = content
    return Contents(entries, settings, damaged)


def damaged_in_words(count: int) -> str:
    """How many lines of manifests could not be read."""
    return f"{count} {'lines' if count > 1 else 'line'} of the manifest could not be read"


def contents_of(place: Place) -> Contents:
    """What the manifests of an archive say, not those of archives below it.

    Raises:
        LogError: one cannot be read, or is larger than manifests get.
    """
    if not is_url(place.root):
        return read_manifests(place.root)
    with place.reading(name for name in place.named() if not os.path.dirname(name)) as folder:
        return read_manifests(folder)


def done_before(place: Place, contents: Contents) -> dict[str, Entry]:
    """The entries whose results are there, by the paths of the results."""
    done = {path: entry for path, entry in contents.entries.items() if entry.status in DONE}
    sizes = place.sizes(done)
    return {path: entry for path, entry in done.items() if sizes.get(path) == entry.output_bytes}


def is_unchanged(place: Place, entry: Entry) -> bool:
    """Whether all files that were written for a log still have the content that they had then; they are read.

    Of an entry without sums, as earlier versions wrote it, nothing is known of its files.
    """
    with place.reading(entry.sums) as folder:
        files = {os.path.join(folder, name): expected for name, expected in entry.sums.items()}
        same = (os.path.isfile(path) and sha256_of(path) == expected for path, expected in files.items())
        return entry.output in entry.sums and all(same)


def read_lines(path: Path) -> Iterator[Entry | Settings | None]:
    """What the lines of a manifest say, one after the other; None for a line that is damaged or torn.

    The last line is torn if a process was killed while it wrote it.

    Raises:
        LogError: the file is larger than manifests get.
    """
    for line in _lines(path):
        try:
            ((kind, content),) = json.loads(line).items()
            if kind == "settings":
                yield read_settings(content)
            elif kind == "log":
                yield read_entry(content)
        except DAMAGED:
            yield None


def _lines(path: Path) -> Iterator[bytes]:
    """The lines of a file; of one that is longer than any the beginning, which is no JSON."""
    try:
        if no_regular_file(path):
            return
        with open(path, "rb") as file:
            _check_size(path, os.fstat(file.fileno()).st_size, MOST_BYTES)
            while line := file.readline(LONGEST_LINE):
                whole = line.endswith(b"\n")
                if line.strip():
                    yield line
                while not whole and (rest := file.readline(LONGEST_LINE)):
                    whole = rest.endswith(b"\n")
    except OSError:
        return


def _check_size(path: Path, size: int, most: int) -> None:
    if size > most:
        message = f"{size / 2**20:,.0f} MiB, more than the {most // 2**20} MiB that a manifest may have"
        remedy = "move it away, and give the rest of the logs a folder of results of their own"
        raise LogError(message, file=path, remedy=remedy)


def _read_old(path: Path) -> Iterator[Entry | Settings | None]:
    """A manifest of schema 1."""
    try:
        if no_regular_file(path):
            return
        _check_size(path, path.stat().st_size, MOST_OLD_BYTES)
        content = json.loads(path.read_text())
        for fields in content["logs"] if content["schema"] == 1 else []:
            made_from = fields["made_from"]
            names = ("log", "output", "status", "error", "repairs", "samples", "output_bytes")
            state = LogState(made_from["log_bytes"], made_from["log_modified_ns"], 0, "")
            used = {name: made_from[name] for name in ("setup_sha256", "choices", "version")}
            settings = read_settings({"job": "filter", **used})
            yield settings
            yield read_entry(
                {name: fields[name] for name in names} | {"state": state._asdict(), "settings": settings.key}
            )
    except OSError:
        return
    except DAMAGED:
        yield None


def _ends_in_the_middle(path: str) -> bool:
    """Whether the last line has no end, because a process was killed while it wrote it."""
    with open(path, "rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(size - 1, 0))
        return size > 0 and file.read(1) != b"\n"
