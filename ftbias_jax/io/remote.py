"""Logs by URL, from object stores and web servers: copied to a temporary file by fsspec (extra ``remote``).

A URL may contain a password or a signature. All output names it by ``without_credentials``, which omits them.

This module alone decides which files may be read, and where copies and results are written, if a setup, a server's
listing or a URL names them. A setup is a file that people pass on, and a listing is written by whoever runs the server.
What they name is read only in the log's folder, unless the user allows more, and is never the path of a written file.
"""

import atexit
import hashlib
import os
import re
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar
from urllib.parse import unquote

from ftbias_jax.errors import LogError, OutputError, SetupError
from ftbias_jax.files import keep_temporary_folder, remove_temporary_folder
from ftbias_jax.io.budget import need
from ftbias_jax.io.ros.record import PACKED, SUFFIXES
from ftbias_jax.io.tables.arrays import TABLES

Source = TypeVar("Source")
MOST_BYTES = 16 << 30
"""Maximum bytes of one file: as many as the numbers of a log may have (``io.budget``)."""
MOST_KEPT = 8
"""Number of copies that are kept at a time; a log has four files at most."""
BYTES_AT_ONCE = 1 << 20
WORD = "--allow-outside, or load_setup(..., allow_outside=True), allows it"
NAMED = 16
"""Number of characters of a hash that name a copy."""
_kept: dict[str, str] = {}
"""URL -> folder of its copy, the oldest first."""
_sums: dict[str, str] = {}
"""URL -> SHA-256 of the copied file."""


def exists(path: str) -> bool:
    """Whether a file exists; a URL is assumed to exist until it is read."""
    return is_url(path) or os.path.exists(path)


def from_anywhere(source: Source) -> Source | str:
    """Make a path absolute for processes with another working directory; a URL, or a log in memory, stays as it is."""
    is_path = isinstance(source, str | os.PathLike) and not is_url(source)
    return os.path.abspath(str(source)) if is_path else source


def without_credentials(path: str | os.PathLike[str]) -> str:
    """A path as it is; a URL without possible secrets: user, password, and the query of a web server."""
    name = os.fspath(path)
    if not is_url(name):
        return name
    scheme, rest = name.split("://", 1)
    host, slash, inner = rest.partition("/")
    inner = re.split(r"[?#]", inner)[0] if scheme.startswith("http") else inner
    return f"{scheme}://{host.rpartition('@')[2]}{slash}{inner}"


@contextmanager
def opened(path: str | os.PathLike[str]) -> Iterator[str]:
    """Path of the file itself, or of a copy of a URL's file; errors about the copy name the URL."""
    name = os.fspath(path)
    if not is_url(name):
        yield name
        return
    copy = local_copy(name)
    try:
        yield copy
    except LogError as error:
        if error.file != copy:
            raise
        raise LogError(error.message, file=without_credentials(name), field=error.field, remedy=error.remedy) from error


def local_copy(url: str) -> str:
    """Path of the copy of a URL's file, made once and removed when the process ends."""
    name = copy_name(without_credentials(url))
    if url not in _kept:
        while len(_kept) >= MOST_KEPT:
            remove_temporary_folder(_kept.pop(next(iter(_kept))))
        folder = keep_temporary_folder()
        try:
            _sums[url] = _copy(url, os.path.join(folder, name))
        except BaseException:
            remove_temporary_folder(folder)
            raise
        _kept[url] = folder
    return os.path.join(_kept[url], name)


def sha256_of_url(url: str) -> str:
    """SHA-256 of a URL's file."""
    if url not in _sums:
        local_copy(url)
    return _sums[url]


def size_and_time(url: str) -> tuple[int, int]:
    """Size in bytes and time of the last change in ns since 1970; (0, now) if the server does not state these.

    An unknown time is replaced by the current one, so that nothing counts as unchanged because of it.
    """
    try:
        system, path = store_of(url)
        return int(system.info(path)["size"] or 0), int(system.modified(path).timestamp() * 1e9)
    except Exception:  # every kind of store has its own exceptions; reading the file reports the fault
        return 0, time.time_ns()


def listed(url: str) -> list[str]:
    """URLs of the files that match a pattern with *, or that are in and below a folder; otherwise the URL itself."""
    with url_errors(url):
        system, path = store_of(url)
        if "*" not in path and not system.isdir(path):
            return [url]
        found = [str(name) for name in (system.glob(path) if "*" in path else system.find(path))]
    _check_listing(found, path, url)
    # Some stores keep the host in their names, as the bucket; others drop it.
    scheme, _, rest = url.partition("://")
    host, _, inner = rest.partition("/")
    lost = host and unquote(path).strip("/") == unquote(inner).strip("/")
    start = f"{scheme}://{host}/"
    return sorted(start + name.lstrip("/") if lost else str(system.unstrip_protocol(name)) for name in found)


def sizes_below(url: str) -> dict[str, int]:
    """Sizes in bytes of the files in and below a folder, by their relative names, as the store has them now."""
    with url_errors(url):
        system, path = store_of(url)
        system.invalidate_cache()
        try:
            found = {str(name): int(info["size"] or 0) for name, info in system.find(path, detail=True).items()}
        except FileNotFoundError:
            return {}
    _check_listing(found, path, url)
    start = f"{path.rstrip('/')}/"
    return {name.removeprefix(start): size for name, size in found.items() if name.startswith(start)}


def store_of(url: str) -> tuple[Any, str]:
    """The fsspec file system of a URL, and the path in it."""
    system, path = need("fsspec", "remote", without_credentials(url)).core.url_to_fs(url)
    return system, str(path)


def _check_listing(found: Iterable[str], path: str, url: str) -> None:
    for name in found:
        if not is_below(name, path):
            remedy = "give the URLs of the logs themselves"
            raise LogError(
                f"its listing names {without_credentials(name)!r}, which is not in it",
                file=without_credentials(url),
                remedy=remedy,
            )


def forget() -> None:
    """Remove all copies."""
    for folder in _kept.values():
        remove_temporary_folder(folder)
    _kept.clear()
    _sums.clear()


atexit.register(forget)


def _copy(url: str, target: str) -> str:
    """Copy a URL's file to ``target``; return its SHA-256."""
    digest, count = hashlib.sha256(), 0
    with url_errors(url):
        fsspec: Any = need("fsspec", "remote", without_credentials(url))
        with fsspec.open(url, "rb") as remote, open(target, "wb") as file:
            while chunk := remote.read(BYTES_AT_ONCE):
                count += len(chunk)
                if count > MOST_BYTES:
                    remedy = "split the log, or copy it yourself"
                    raise LogError(f"has more than {MOST_BYTES} bytes", file=without_credentials(url), remedy=remedy)
                digest.update(chunk)
                file.write(chunk)
    return digest.hexdigest()


@contextmanager
def url_errors(url: str, kind: type[LogError | OutputError] = LogError) -> Iterator[None]:
    """Convert exceptions of fsspec and its stores to errors that name the URL: LogError on reading, or OutputError."""
    done = "read" if kind is LogError else "written"
    try:
        yield
    except (LogError, OutputError):
        raise
    except ImportError as error:  # s3fs, gcsfs, aiohttp, ...
        message, remedy = f"its store needs another package: {error}", "install that package"
        raise kind(message, file=without_credentials(url), remedy=remedy) from error
    except Exception as error:  # every kind of store has its own exceptions
        words, remedy = _without_secrets(str(error), url) or type(error).__name__, "check the URL and your rights there"
        raise kind(f"cannot be {done}: {words}", file=without_credentials(url), remedy=remedy) from error


def _without_secrets(words: str, url: str) -> str:
    """Remove the secrets that ``without_credentials`` omits from a message about a URL, as a whole and in parts."""
    user = url.partition("://")[2].partition("/")[0].rpartition("@")[0]
    query = re.split(r"[?#]", url, maxsplit=1)[1:] if url.startswith("http") else []
    secrets = {part for text in (user, *user.split(":"), *query) for part in (text, unquote(text)) if part}
    words = words.replace(url, without_credentials(url))
    for secret in sorted(secrets, key=len, reverse=True):
        words = words.replace(secret, "...")
    return words


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

    This includes the named file: commands name a log by the file of its wrench, whichever file the user has given.
    """
    for key, file in files.items():
        if is_url(named):  # a listing provides the text that * stands for
            inside = not _is_upward(file)
        else:
            folder = os.path.realpath(os.path.dirname(os.path.abspath(named)))
            inside = os.path.commonpath([folder, os.path.realpath(file)]) == folder
        if not inside:
            message, remedy = "is a link that leads out of the log's folder", f"copy the file there; {WORD}"
            raise LogError(message, file=file, field=f"log.files.{key}", remedy=remedy)


def copy_name(url: str) -> str:
    """File name for the copy of a URL's file: a hash of the URL, and its suffix, which must be that of a log."""
    known = tuple(suffix + packed for suffix in (*SUFFIXES, *TABLES) for packed in ("", PACKED))
    # The part after ? is a query, or in an object store part of the name.
    name, *whole = re.split(r"[?#]", url)[0], *([] if url.startswith("http") else [url])
    ends = (suffix for each in (name, *whole) for suffix in known if unquote(each).lower().endswith(suffix))
    suffix = max(ends, key=len, default="")
    if not suffix:
        remedy = f"give the URL of a log that ends in {', '.join((*TABLES, *SUFFIXES))}"
        raise LogError("has no suffix of a log", file=url, remedy=remedy)
    return hashlib.sha256(url.encode(errors="surrogatepass")).hexdigest()[:NAMED] + suffix


def is_below(name: str, folder: str) -> bool:
    """Whether a name in a server's listing is the requested path, or below it."""
    top = folder.partition("*")[0].rpartition("/")[0] if "*" in folder else folder.rstrip("/")
    if name != folder and not name.startswith(f"{top}/"):
        return False
    return name.isprintable() and not _is_upward(name) and not _is_chain(name[len(top) :])


def _is_upward(name: str) -> bool:
    """Whether a part of a name leads to the parent folder, in any spelling that a server or a system may accept."""
    return ".." in re.split(r"[/\\]", unquote(name))


def _is_chain(name: str) -> bool:
    """Whether a name contains a URL, or a chain of them for fsspec, such as ``zip::file:/...``."""
    return "://" in name or "::" in name


def check_planned(output: str, log: str) -> None:
    """Refuse a result that would be written outside of the folder of results."""
    if os.path.isabs(output) or ".." in output.split(os.sep):
        raise LogError(f"its result would be written to {output!r}", file=log, remedy="give the logs one by one")
