"""Logs by URL, from object stores and web servers: copied to a temporary file by fsspec (extra ``remote``).

A URL may carry a password or a signature. Whatever is written names it by ``shown``, which leaves them out.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import unquote

from ftbias_jax.errors import LogError
from ftbias_jax.files import keep_temporary_folder, remove_temporary_folder
from ftbias_jax.io.limits.budget import need
from ftbias_jax.io.remote.outside import copy_name, is_below, is_url

MOST_BYTES = 16 << 30
"""Of one file: as much as the numbers of a log may have (``limits.budget``)."""
MOST_KEPT = 8
"""Copies that are kept at a time; a log has four files at most."""
BYTES_AT_ONCE = 1 << 20
_kept: dict[str, str] = {}
"""URL -> folder of its copy, the oldest first."""
_sums: dict[str, str] = {}
"""URL -> SHA-256 of what was copied."""


def exists(path: str) -> bool:
    """Whether a file is there; of a URL it is assumed until it is read."""
    return is_url(path) or os.path.exists(path)


def shown(path: str | os.PathLike[str]) -> str:
    """A path as it is; a URL without what may be secret: user, password, and of a web server the query."""
    name = os.fspath(path)
    if not is_url(name):
        return name
    scheme, rest = name.split("://", 1)
    host, slash, inner = rest.partition("/")
    inner = re.split(r"[?#]", inner)[0] if scheme.startswith("http") else inner
    return f"{scheme}://{host.rpartition('@')[2]}{slash}{inner}"


@contextmanager
def opened(path: str | os.PathLike[str]) -> Iterator[str]:
    """The file itself, or a copy of what a URL names; errors about the copy name the URL."""
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
        raise LogError(error.message, file=shown(name), field=error.field, remedy=error.remedy) from error


def local_copy(url: str) -> str:
    """Path of a copy of what a URL names, made once; the process removes it at its end."""
    name = copy_name(shown(url))
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


def sum_of(url: str) -> str:
    """SHA-256 of what a URL names."""
    if url not in _sums:
        local_copy(url)
    return _sums[url]


def size_and_time(url: str) -> tuple[int, int]:
    """Bytes, and the time of the last change in ns since 1970; (0, now) where the server does not tell.

    A time that is not known is that of now, so that nothing counts as unchanged because of it.
    """
    try:
        system, path = need("fsspec", "remote").core.url_to_fs(url)
        return int(system.info(path)["size"] or 0), int(system.modified(path).timestamp() * 1e9)
    except Exception:  # every kind of store has exceptions of its own; whoever reads the file tells what is wrong
        return 0, time.time_ns()


def listed(url: str) -> list[str]:
    """URLs of the files that fit a pattern with *, or that are in and below a folder; otherwise the URL itself."""
    with _told(url):
        system, path = need("fsspec", "remote", shown(url)).core.url_to_fs(url)
        if "*" not in path and not system.isdir(path):
            return [url]
        found = [str(name) for name in (system.glob(path) if "*" in path else system.find(path))]
    for name in found:
        if not is_below(name, str(path)):
            remedy = "give the URLs of the logs themselves"
            message = f"its listing names {shown(name)!r}, which is not in it"
            raise LogError(message, file=shown(url), remedy=remedy)
    # Some stores have the host in their names, as buckets; others lose it.
    scheme, _, rest = url.partition("://")
    host, _, inner = rest.partition("/")
    lost = host and unquote(str(path)).strip("/") == unquote(inner).strip("/")
    start = f"{scheme}://{host}/"
    return sorted(start + name.lstrip("/") if lost else str(system.unstrip_protocol(name)) for name in found)


def forget() -> None:
    """Remove all copies."""
    for folder in _kept.values():
        remove_temporary_folder(folder)
    _kept.clear()
    _sums.clear()


atexit.register(forget)


def _copy(url: str, target: str) -> str:
    """Copy to a file; returns the SHA-256."""
    digest, count = hashlib.sha256(), 0
    with _told(url):
        fsspec: Any = need("fsspec", "remote", shown(url))
        with fsspec.open(url, "rb") as remote, open(target, "wb") as file:
            while chunk := remote.read(BYTES_AT_ONCE):
                count += len(chunk)
                if count > MOST_BYTES:
                    remedy = "split the log, or copy it yourself"
                    raise LogError(f"has more than {MOST_BYTES} bytes", file=shown(url), remedy=remedy)
                digest.update(chunk)
                file.write(chunk)
    return digest.hexdigest()


@contextmanager
def _told(url: str) -> Iterator[None]:
    """What fsspec and its stores raise, as an error that names the URL."""
    try:
        yield
    except LogError:
        raise
    except ImportError as error:  # s3fs, gcsfs, aiohttp, ...
        message, remedy = f"its store needs another package: {error}", "install that package"
        raise LogError(message, file=shown(url), remedy=remedy) from error
    except Exception as error:  # every kind of store has exceptions of its own
        words = _without_secrets(str(error), url) or type(error).__name__
        raise LogError(
            f"cannot be read: {words}", file=shown(url), remedy="check the URL and who may read it"
        ) from error


def _without_secrets(words: str, url: str) -> str:
    """Words about a URL without what ``shown`` leaves out of it, as a whole and in its parts."""
    user = url.partition("://")[2].partition("/")[0].rpartition("@")[0]
    query = re.split(r"[?#]", url, maxsplit=1)[1:] if url.startswith("http") else []
    secrets = {part for text in (user, *user.split(":"), *query) for part in (text, unquote(text)) if part}
    words = words.replace(url, shown(url))
    for secret in sorted(secrets, key=len, reverse=True):
        words = words.replace(secret, "...")
    return words
