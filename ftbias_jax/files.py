"""Files as the operating system has them: what a path names, and temporary files that must not outlive the process."""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress

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


@contextmanager
def temporary_folder() -> Iterator[str]:
    """A new folder, which is removed at the end with all that is in it, also by a signal."""
    folder = tempfile.mkdtemp(prefix="ftbias-")
    _temporary.add(folder)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        _temporary.discard(folder)


def remove_temporary() -> None:
    """Remove what is still there, before the process ends without unwinding."""
    for path in list(_temporary):
        with suppress(OSError):
            shutil.rmtree(path, ignore_errors=True) if os.path.isdir(path) else os.unlink(path)
