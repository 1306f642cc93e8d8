"""Files as the operating system has them: what a path names, and temporary files that must not outlive the process."""

import os
import secrets
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import BinaryIO

_KINDS = {
    stat.S_IFIFO: "is a FIFO",
    stat.S_IFCHR: "is a device",
    stat.S_IFBLK: "is a device",
    stat.S_IFSOCK: "is a socket",
    stat.S_IFDIR: "is a folder",
}
_temporary: set[str] = set()


def no_regular_file(path: str | os.PathLike[str]) -> str:
    """Why a path that is there cannot be read as a file, such as "is a FIFO"; "" if it can be.

    A FIFO waits for a writer and a device may never end, so both are refused before they are opened.

    Raises:
        OSError: it is not there, or symbolic links lead in a circle.
    """
    kind = stat.S_IFMT(os.stat(path).st_mode)
    return "" if kind == stat.S_IFREG else _KINDS.get(kind, "is not a regular file")


@contextmanager
def temporary(path: str) -> Iterator[str]:
    """A file's name, under which nothing is left at the end, not even if the process is ended by a signal."""
    _temporary.add(path)
    try:
        yield path
    finally:
        with suppress(OSError):  # it may have been renamed
            os.unlink(path)
        _temporary.discard(path)


def replace_whole(target: str, write: Callable[[BinaryIO], object]) -> None:
    """Write a file through a temporary one beside it: written, flushed to disk, then renamed.

    Args:
        target: the file to make or replace, without links.
        write: called once with the open temporary file.

    Raises:
        OSError: it cannot be written; what stood there before still stands there.
    """
    folder = os.path.dirname(target)
    unfinished = os.path.join(folder, f".ftbias-{secrets.token_hex(8)}.tmp")
    with temporary(unfinished):
        _write_new(unfinished, write)
        os.replace(unfinished, target)
    _sync_folder(folder)


def open_to_append(target: str) -> BinaryIO:
    """A file to add lines to, made if it is not there; each write goes to its end, also beside other processes.

    Raises:
        OSError: it cannot be opened, or is a symbolic link.
    """
    how = os.O_RDWR | os.O_CREAT | os.O_APPEND | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
    return open(os.open(target, how, 0o666), "ab")


@contextmanager
def temporary_folder() -> Iterator[str]:
    """A new folder, which is removed at the end with all that is in it, also by a signal."""
    folder = keep_temporary_folder()
    try:
        yield folder
    finally:
        remove_temporary_folder(folder)


def keep_temporary_folder() -> str:
    """A new folder until ``remove_temporary_folder``; a signal removes it, too."""
    folder = tempfile.mkdtemp(prefix="ftbias-")
    _temporary.add(folder)
    return folder


def remove_temporary_folder(folder: str) -> None:
    """Remove a folder with all that is in it."""
    shutil.rmtree(folder, ignore_errors=True)
    _temporary.discard(folder)


def remove_temporary() -> None:
    """Remove what is still there, before the process ends without unwinding."""
    for path in list(_temporary):
        with suppress(OSError):
            shutil.rmtree(path, ignore_errors=True) if os.path.isdir(path) else os.unlink(path)


def _write_new(path: str, write: Callable[[BinaryIO], object]) -> None:
    # Not the tempfile module: its files are private (mode 0600), a result has the mode of any new file.
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o666), "wb") as file:
        write(file)
        file.flush()
        os.fsync(file.fileno())


def _sync_folder(folder: str) -> None:
    """Make the rename itself last; where folders cannot be opened or synced the operating system decides."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
