"""Operating-system files: the kind of file a path names, and temporary files that must not outlive the process."""

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
    """Reason why an existing path cannot be read as a file, such as "is a FIFO"; "" if it can be.

    Reading a FIFO waits for a writer and a device may never end, so both are refused before they are opened.

    Raises:
        OSError: the path does not exist, or its symbolic links form a cycle.
    """
    kind = stat.S_IFMT(os.stat(path).st_mode)
    return "" if kind == stat.S_IFREG else _KINDS.get(kind, "is not a regular file")


@contextmanager
def temporary(path: str) -> Iterator[str]:
    """Yield the name of a file that is removed at the end, also if a signal ends the process."""
    _temporary.add(path)
    try:
        yield path
    finally:
        with suppress(OSError):  # The file may have been renamed.
            os.unlink(path)
        _temporary.discard(path)


def replace_whole(target: str, write: Callable[[BinaryIO], object]) -> None:
    """Replace a file as a whole: write a temporary file beside it, flush that to disk, then rename it.

    Args:
        target: the file to create or replace, without links.
        write: called once with the open temporary file.

    Raises:
        OSError: the file cannot be written; a previous file of that name is unchanged.
    """
    folder = os.path.dirname(target)
    unfinished = os.path.join(folder, f".ftbias-{secrets.token_hex(8)}.tmp")
    with temporary(unfinished):
        _write_new(unfinished, write)
        os.replace(unfinished, target)
    _sync_folder(folder)


def open_to_append(target: str) -> BinaryIO:
    """Open a file for appending, created if it is missing; each write goes to its end even if other processes append.

    Raises:
        OSError: the file cannot be opened, or is a symbolic link.
    """
    how = os.O_RDWR | os.O_CREAT | os.O_APPEND | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
    return open(os.open(target, how, 0o666), "ab")


@contextmanager
def temporary_folder() -> Iterator[str]:
    """Yield a new folder that is removed with its contents at the end, also if a signal ends the process."""
    folder = keep_temporary_folder()
    try:
        yield folder
    finally:
        remove_temporary_folder(folder)


def keep_temporary_folder() -> str:
    """Create a folder that exists until ``remove_temporary_folder`` or until a signal ends the process."""
    folder = tempfile.mkdtemp(prefix="ftbias-")
    _temporary.add(folder)
    return folder


def remove_temporary_folder(folder: str) -> None:
    """Remove a temporary folder with its contents."""
    shutil.rmtree(folder, ignore_errors=True)
    _temporary.discard(folder)


def remove_temporary() -> None:
    """Remove all remaining temporary files and folders, before the process ends without unwinding its stack."""
    for path in list(_temporary):
        with suppress(OSError):
            shutil.rmtree(path, ignore_errors=True) if os.path.isdir(path) else os.unlink(path)


def _write_new(path: str, write: Callable[[BinaryIO], object]) -> None:
    # Files of the tempfile module are private (mode 0600), but a result should have the mode of any new file.
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o666), "wb") as file:
        write(file)
        file.flush()
        os.fsync(file.fileno())


def _sync_folder(folder: str) -> None:
    """Make the rename durable; where folders cannot be opened or synced, the operating system decides."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
