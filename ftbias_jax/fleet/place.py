"""Location of an archive: a folder of this machine, or a part of a bucket of any store that fsspec writes to.

Results are written and read as files of a folder. For a bucket, it is a temporary folder: files to read are copied into
it, and complete files that were written are uploaded one by one, each of which object stores do atomically.

Objects cannot be appended to: a file to which lines are appended is uploaded as a whole every time.
"""

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

from ftbias_jax.errors import FtbiasError, OutputError
from ftbias_jax.files import temporary_folder
from ftbias_jax.io.atomic import make_folder
from ftbias_jax.io.remote import is_url, sizes_below, store_of, url_errors, without_credentials

MANIFESTS = "manifest*.json*"


class Growing(NamedTuple):
    """A file to which lines are appended."""

    path: str
    """Path on this machine."""
    publish: Callable[[], None] | None = None
    """Uploads the current lines of the file to the bucket; None = the file itself is in the archive."""


class Place(NamedTuple):
    """Location of an archive; picklable, for workers on other machines."""

    root: str
    """Path of a folder, or a URL."""

    def path(self, name: str) -> str:
        """Path or URL, as it is displayed, of a file of the archive; "" = the archive itself."""
        return without_credentials(os.path.join(self.root, name) if name else self.root)

    def sizes(self, names: Iterable[str]) -> dict[str, int]:
        """Name -> size in bytes, for the given files that exist."""
        if is_url(self.root):
            there = sizes_below(self.root)
            return {name: there[name] for name in names if name in there}
        paths = {name: Path(self.root, name) for name in names}
        return {name: path.stat().st_size for name, path in paths.items() if path.is_file()}

    def named(self, pattern: str = MANIFESTS) -> list[str]:
        """Names of all files in and below the archive that match a pattern, by default its manifests."""
        if is_url(self.root):
            return sorted(name for name in sizes_below(self.root) if Path(name).match(pattern))
        return sorted(os.path.relpath(path, self.root) for path in Path(self.root).rglob(pattern))

    @contextmanager
    def reading(self, names: Iterable[str]) -> Iterator[str]:
        """Context of a folder that contains the given files, as far as they exist.

        Raises:
            LogError: the files cannot be read.
        """
        if not is_url(self.root):
            yield self.root
            return
        with temporary_folder() as folder, self._named_in_errors(folder):
            with url_errors(self.root):
                system, there = store_of(self.root)
                for name in names:
                    copy = os.path.join(folder, name)
                    make_folder(os.path.dirname(copy))
                    with suppress(FileNotFoundError):
                        system.get_file(_object(there, name), copy)
            yield folder

    @contextmanager
    def writing(self) -> Iterator[str]:
        """Context of a folder whose files are in the archive at the end, if no error occurs.

        Raises:
            OutputError: the files cannot be uploaded.
        """
        if not is_url(self.root):
            yield self.root
            return
        with temporary_folder() as folder:
            with self._named_in_errors(folder):
                yield folder
            with url_errors(self.root, OutputError):
                system, there = store_of(self.root)
                for file in filter(Path.is_file, Path(folder).rglob("*")):
                    system.put_file(str(file), _object(there, file.relative_to(folder).as_posix()))

    @contextmanager
    def growing(self, name: str) -> Iterator[Growing]:
        """Context of a file of the archive to which lines are appended; in a bucket, by one process at a time.

        Raises:
            LogError: the existing file cannot be read. OutputError: the folder or a line cannot be written.
        """
        if not is_url(self.root):
            make_folder(self.root)
            yield Growing(os.path.join(self.root, name))
            return
        with self.reading([name]) as folder:
            path = os.path.join(folder, name)

            def publish() -> None:
                with url_errors(self.root, OutputError):
                    system, there = store_of(self.root)
                    system.put_file(path, _object(there, name))

            try:
                yield Growing(path, publish)
            finally:
                publish()

    @contextmanager
    def _named_in_errors(self, folder: str) -> Iterator[None]:
        """Make errors about files of a temporary folder name the files of the archive."""
        try:
            yield
        except FtbiasError as error:
            if not error.file.startswith(folder):
                raise
            file = self.path(os.path.relpath(error.file, folder))
            raise type(error)(error.message, file=file, field=error.field, remedy=error.remedy) from error


def _object(there: str, name: str) -> str:
    return f"{there.rstrip('/')}/{name}"
