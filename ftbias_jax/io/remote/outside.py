"""What may be read, and where copies and results go, that a setup, a listing or an address names: decided here alone.

A setup is a file that people pass on, and a server's listing is written by whoever runs it. What they name is read only
inside the log's own folder, unless the user says otherwise, and never becomes the path of a file that is written.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Mapping
from urllib.parse import unquote

from ftbias_jax.errors import LogError, SetupError
from ftbias_jax.io.ros.record import PACKED, SUFFIXES
from ftbias_jax.io.tables.arrays import TABLES

WORD = "--allow-outside, or load_setup(..., allow_outside=True), allows it"
NAMED = 16
"""Characters of a hash that name a copy."""


def is_url(path: str | os.PathLike[str]) -> bool:
    """Whether a path is a URL, such as s3://bucket/run.npz."""
    return re.match(r"[A-Za-z][A-Za-z0-9+.-]+://", os.fspath(path)) is not None


def check_patterns(patterns: Mapping[str, str], file: str = "") -> None:
    """Refuse [log.files] of a setup that name anything but files in the log's folder or below."""
    for key, pattern in patterns.items():
        what = "is an address" if _is_chain(pattern) else "leads out of the log's folder" if _is_upward(pattern) else ""
        if os.path.isabs(pattern) or re.match(r"[A-Za-z]:[/\\]|[/\\~]", pattern):
            what = what or "is an absolute path"
        if what:
            field, remedy = f"log.files.{key}", f"name a file beside the log; {WORD}"
            raise SetupError(f"{pattern!r} {what}", file=file, field=field, remedy=remedy)


def check_links(files: Mapping[str, str], named: str) -> None:
    """Refuse files of a log that are links out of its folder.

    That holds for the named one, too: commands name a log by the file of its wrench, whichever the user has given.
    """
    for key, file in files.items():
        if is_url(named):  # what the * stands for comes from a listing
            inside = not _is_upward(file)
        else:
            folder = os.path.realpath(os.path.dirname(os.path.abspath(named)))
            inside = os.path.commonpath([folder, os.path.realpath(file)]) == folder
        if not inside:
            message, remedy = "is a link that leads out of the log's folder", f"copy the file there; {WORD}"
            raise LogError(message, file=file, field=f"log.files.{key}", remedy=remedy)


def copy_name(url: str) -> str:
    """The name for the copy of what a URL names: a hash of it, and its suffix if a log may have it."""
    known = tuple(suffix + packed for suffix in (*SUFFIXES, *TABLES) for packed in ("", PACKED))
    # What follows a ? is a query, or of an object store part of a name.
    name, *whole = re.split(r"[?#]", url)[0], *([] if url.startswith("http") else [url])
    ends = (suffix for each in (name, *whole) for suffix in known if unquote(each).lower().endswith(suffix))
    suffix = max(ends, key=len, default="")
    if not suffix:
        remedy = f"give the URL of a log that ends in {', '.join((*TABLES, *SUFFIXES))}"
        raise LogError("has no suffix of a log", file=url, remedy=remedy)
    return hashlib.sha256(url.encode(errors="surrogatepass")).hexdigest()[:NAMED] + suffix


def is_below(name: str, folder: str) -> bool:
    """Whether a name in a server's listing is that of what was asked for, or below it."""
    top = folder.partition("*")[0].rpartition("/")[0] if "*" in folder else folder.rstrip("/")
    if name != folder and not name.startswith(f"{top}/"):
        return False
    return name.isprintable() and not _is_upward(name) and not _is_chain(name[len(top) :])


def _is_upward(name: str) -> bool:
    """Whether a part of a name leads to the folder above, in whatever spelling a server or a system may read it."""
    return ".." in re.split(r"[/\\]", unquote(name))


def _is_chain(name: str) -> bool:
    """Whether there is an address in a name, or what fsspec takes for one: ``zip::file:/...`` is several in a row."""
    return "://" in name or "::" in name


def check_planned(output: str, log: str) -> None:
    """Refuse a result that would be written outside of the folder of results."""
    if os.path.isabs(output) or ".." in output.split(os.sep):
        remedy = "give the logs one by one"
        raise LogError(f"its result would be written to {output!r}", file=log, remedy=remedy)
