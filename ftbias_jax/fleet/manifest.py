"""Manifest of a folder of results: an append-only file of JSON lines, one for each processed log.

A line costs the same for the first log and for the ten thousandth, and a process that is killed while it writes loses
only that line. Of several lines about one result, the last one is valid. Other lines record the settings of the logs
(``settings``, once for each) and the start of a run (``run``).
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
"""s between flushes of lines to disk; logs done since then are done again if the machine loses its power."""
PUBLISH_SECONDS = 5.0
"""s between uploads of lines to a bucket; logs done since then are done again if the process is killed."""
PUBLISH_SHARE = 0.05
"""Maximum share of time for flushing or uploading, which is therefore done less often as the manifest grows."""
LONGEST_LINE = 2**20
"""Maximum length of a line, bytes; the line of one log has about a thousand."""
DAMAGED = (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError)
"""Exceptions that a line may raise that this program does not write."""
MOST_BYTES, MOST_OLD_BYTES = 128 * 2**20, 16 * 2**20
"""Maximum size of a manifest, about 120,000 logs in 0.6 GB of memory, and of one of schema 1, which is read whole."""


class Contents(NamedTuple):
    """Contents of the manifests of a folder."""

    entries: dict[str, Entry]
    """Path of the result, or of the log if it has no result -> entry."""
    settings: dict[str, Settings]
    """Key -> settings."""
    damaged: int = 0
    """Number of lines that could not be read."""


class Manifest:
    """The manifest of one run, open for appending.

    Args:
        path: path of the file, which is created if it does not exist.
        publish: uploads the file, every PUBLISH_SECONDS, if it is a copy of a file in a bucket.

    Raises:
        OutputError: the file cannot be written; every method may raise this error.
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
        """Append a line of the kind "log", "settings" or "run" with plain numbers, strings, lists and dicts."""
        line = json.dumps({kind: content}, allow_nan=False, separators=(",", ":")) + "\n"
        with _errors_of(self.path):
            self._file.write(line.encode())
            self._file.flush()
            # The line of a run is flushed immediately, so that an unwritable manifest ends the run at its start.
            started = time.monotonic()
            if kind == "run" or started > self._next:
                (self._publish or partial(os.fsync, self._file.fileno()))()
                now = time.monotonic()
                self._next = now + max(self._seldom, (now - started) / PUBLISH_SHARE)

    def add_entry(self, entry: Entry) -> None:
        """Append the entry of a log."""
        self.add("log", {**entry._asdict(), "state": entry.state._asdict()})

    def __enter__(self) -> Manifest:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        # If the body has failed, its error is the one to report.
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
    """Name of the manifest of one command on one machine; each has its own, so that none waits for another."""
    return f"manifest.{job}.jsonl" if count == 1 else f"manifest.{job}.{index}-of-{count}.jsonl"


def read_manifests(folder: str) -> Contents:
    """Read the manifests in a folder.

    Raises:
        LogError: a manifest exceeds its maximum size.
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
    """Sentence with the number of lines of a manifest that could not be read."""
    return f"{count} {'lines' if count > 1 else 'line'} of the manifest could not be read"


def contents_of(place: Place) -> Contents:
    """Contents of the manifests of an archive, without those of archives below it.

    Raises:
        LogError: a manifest cannot be read, or exceeds its maximum size.
    """
    if not is_url(place.root):
        return read_manifests(place.root)
    with place.reading(name for name in place.named() if not os.path.dirname(name)) as folder:
        return read_manifests(folder)


def done_before(place: Place, contents: Contents) -> dict[str, Entry]:
    """Path of the result -> entry, for entries whose result exists with its recorded size."""
    done = {path: entry for path, entry in contents.entries.items() if entry.status in DONE}
    sizes = place.sizes(done)
    return {path: entry for path, entry in done.items() if sizes.get(path) == entry.output_bytes}


def is_unchanged(place: Place, entry: Entry) -> bool:
    """Whether all files that were written for a log still have their original SHA-256; the files are read.

    False for an entry without SHA-256, as earlier versions wrote it.
    """
    with place.reading(entry.sums) as folder:
        files = {os.path.join(folder, name): expected for name, expected in entry.sums.items()}
        same = (os.path.isfile(path) and sha256_of(path) == expected for path, expected in files.items())
        return entry.output in entry.sums and all(same)


def read_lines(path: Path) -> Iterator[Entry | Settings | None]:
    """Yield the entries and settings of a manifest, line by line; None for a damaged or incomplete line.

    The last line is incomplete if a process was killed while it wrote it.

    Raises:
        LogError: the manifest exceeds its maximum size.
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
    """Yield the lines of a file; a line above the maximum length is cut off, so that it is no longer valid JSON."""
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
    """Yield the settings and entries of a manifest of schema 1."""
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
    """Whether the last line is incomplete, because a process was killed while it wrote it."""
    with open(path, "rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(size - 1, 0))
        return size > 0 and file.read(1) != b"\n"
