"""The manifest of a folder of results: lines of JSON that are only ever added, one for each log that is done.

A line costs the same for the first log and for the ten thousandth, and a process that is killed in the middle of one
loses that line alone. Of several lines about one result the last one holds. Other lines say what the logs were worked
on with (``settings``, once for each) and that a run began (``run``).
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, TypeVar

from ftbias_jax.errors import OutputError
from ftbias_jax.files import no_regular_file, open_to_append
from ftbias_jax.fleet.entry import DONE, Entry, LogState, Settings
from ftbias_jax.io.atomic import refuse_link

SCHEMA = 2
Read = TypeVar("Read", Entry, LogState)
SYNC_SECONDS = 1.0
"""Lines are flushed to disk at least so often; logs done since are done again if the machine loses its power."""


class Contents(NamedTuple):
    """What the manifests of a folder say."""

    entries: dict[str, Entry]
    """By the paths of results; by those of logs where there is no result."""
    settings: dict[str, Settings]
    """By their keys."""


class Manifest:
    """The manifest of one run, open for new lines.

    Args:
        path: of the file, which is made if it is not there.

    Raises:
        OutputError: it cannot be written; every method raises it, too.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self._synced = time.monotonic()
        refuse_link(path)
        try:
            self._file = open_to_append(path)
            if _ends_in_the_middle(path):
                self._file.write(b"\n")
        except OSError as error:
            raise self._failed(error) from error

    def add(self, kind: str, content: Mapping[str, Any]) -> None:
        """Add a line.

        Args:
            kind: "log", "settings" or "run".
            content: plain numbers, words, lists and dicts.
        """
        line = json.dumps({kind: content}, allow_nan=False, separators=(",", ":")) + "\n"
        try:
            self._file.write(line.encode())
            self._file.flush()
            if time.monotonic() > self._synced + SYNC_SECONDS:
                os.fsync(self._file.fileno())
                self._synced = time.monotonic()
        except OSError as error:
            raise self._failed(error) from error

    def add_entry(self, entry: Entry) -> None:
        """Add what became of a log."""
        self.add("log", {**entry._asdict(), "state": entry.state._asdict()})

    def __enter__(self) -> Manifest:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._file.close()
        except OSError as failed:
            if error is None:  # else the first failure is the one to tell
                raise self._failed(failed) from failed

    def _failed(self, error: OSError) -> OutputError:
        remedy = "check that the folder exists, may be written to and has room"
        return OutputError(f"cannot be written: {error.strerror or error}", file=self.path, remedy=remedy)


def manifest_name(job: str, index: int, count: int) -> str:
    """Every command and every machine writes its own, so that none waits for another."""
    return f"manifest.{job}.jsonl" if count == 1 else f"manifest.{job}.{index}-of-{count}.jsonl"


def read_manifests(folder: str) -> Contents:
    """What the manifests in a folder say; lines that cannot be read say nothing."""
    entries: dict[str, Entry] = {}
    settings: dict[str, Settings] = {}
    old, new = (sorted(Path(folder).glob(pattern)) for pattern in ("manifest*.json", "manifest.*.jsonl"))
    for path in (*old, *new):
        read = _read_old if path.suffix == ".json" else read_lines
        for content in read(path):
            if isinstance(content, Settings):
                settings[content.key] = content
            else:
                place = content.output or content.log
                if place not in entries or content.done >= entries[place].done:
                    entries[place] = content
    return Contents(entries, settings)


def done_before(folder: str, contents: Contents) -> dict[str, Entry]:
    """The entries whose results are there, by the paths of the results."""
    return {output: entry for output, entry in contents.entries.items() if _is_there(Path(folder, output), entry)}


def _is_there(output: Path, entry: Entry) -> bool:
    return entry.status in DONE and output.is_file() and output.stat().st_size == entry.output_bytes


def read_lines(path: Path) -> Iterator[Entry | Settings]:
    """What the lines of a manifest say. The last one is torn if a process was killed while it wrote."""
    try:
        lines = b"" if no_regular_file(path) else path.read_bytes()
    except OSError:
        return
    for line in lines.splitlines():
        try:
            ((kind, content),) = json.loads(line).items()
            if kind == "settings":
                yield Settings(**content)
            elif kind == "log":
                lists = {name: tuple(content.get(name, ())) for name in ("repairs", "files")}
                yield _typed(Entry(**{**content, **lists, "state": _typed(LogState(**content["state"]))}))
        except (ValueError, TypeError, KeyError, AttributeError):
            continue


def _typed(read: Read) -> Read:
    """What was read, if its fields have the types of others of its kind; a manifest can be edited by hand."""
    like = Entry("", "") if isinstance(read, Entry) else LogState(0, 0, 0, "")
    for value, usual in zip(read, like, strict=True):
        kinds = (int, float) if isinstance(usual, float) else type(usual)
        if not isinstance(value, kinds):
            raise TypeError
    return read


def _read_old(path: Path) -> Iterator[Entry | Settings]:
    """A manifest of schema 1."""
    try:
        content = json.loads("" if no_regular_file(path) else path.read_text())
        logs = content["logs"] if content["schema"] == 1 else []
        for fields in logs:
            made_from, known = (
                fields["made_from"],
                {name: fields[name] for name in ("log", "output", "status", "error")},
            )
            settings = Settings("filter", made_from["setup_sha256"], made_from["choices"], made_from["version"])
            state = LogState(made_from["log_bytes"], made_from["log_modified_ns"], 0, "")
            yield settings
            yield Entry(
                **known,
                repairs=tuple(fields["repairs"]),
                samples=fields["samples"],
                output_bytes=fields["output_bytes"],
                state=state,
                settings=settings.key,
            )
    except (OSError, ValueError, TypeError, KeyError):
        return


def _ends_in_the_middle(path: str) -> bool:
    """Whether the last line has no end, because a process was killed while it wrote it."""
    with open(path, "rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(size - 1, 0))
        return size > 0 and file.read(1) != b"\n"
