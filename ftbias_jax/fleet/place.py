"""Where an archive is: a folder of this machine, or a part of a bucket of any store that fsspec writes to.

Results are written and read as files of a folder. For a bucket that is a temporary one: what is written there is
published file by file once it is whole, which object stores do whole or not at all, and what is read is copied there.

Objects cannot grow: a file to which lines are added is sent as a whole, again and again.
"""

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

from ftbias_jax.errors import FtbiasError, OutputError
from ftbias_jax.files import temporary_folder
from ftbias_jax.io.atomic import make_folder
from ftbias_jax.io.remote import is_url, shown, sizes_below, store_of, told

MANIFESTS = "manifest*.json*"


class Growing(NamedTuple):
    """A file to which lines are added."""

    path: str
    """On this machine."""
    publish: Callable[[], None] | None = None
    """Brings the lines that the file has by now to the bucket; None = the file is that of the archive."""


class Place(NamedTuple):
    """The place of an archive; can be pickled, for workers on other machines."""

    root: str
    """Path of a folder, or a URL."""

    def path(self, name: str) -> str:
        """Path or URL of a file of the archive, "" = of itself, as it is shown."""
        return shown(os.path.join(self.root, name) if name else self.root)

    def sizes(self, names: Iterable[str]) -> dict[str, int]:
        """Bytes of those of some files that are there."""
        if is_url(self.root):
            there = sizes_below(self.root)
            return {name: there[name] for name in names if name in there}
        paths = {name: Path(self.root, name) for name in names}
        return {name: path.stat().st_size for name, path in paths.items() if path.is_file()}

    def named(self, pattern: str = MANIFESTS) -> list[str]:
        """Names of all files in and below it that match a pattern, such as its manifests."""
        if is_url(self.root):
            return sorted(name for name in sizes_below(self.root) if Path(name).match(pattern))
        return sorted(os.path.relpath(path, self.root) for path in Path(self.root).rglob(pattern))

    @contextmanager
    def reading(self, names: Iterable[str]) -> Iterator[str]:
        """A folder with those of some files that are there.

        Raises:
            LogError: they cannot be read.
        """
        if not is_url(self.root):
            yield self.root
            return
        with temporary_folder() as folder, self._named_in_errors(folder):
            with told(self.root):
                system, there = store_of(self.root)
                for name in names:
                    copy = os.path.join(folder, name)
                    make_folder(os.path.dirname(copy))
                    with suppress(FileNotFoundError):
                        system.get_file(_object(there, name), copy)
            yield folder

    @contextmanager
    def writing(self) -> Iterator[str]:
        """A folder whose files are the archive's in the end, if nothing goes wrong.

        Raises:
            OutputError: they cannot be published.
        """
        if not is_url(self.root):
            yield self.root
            return
        with temporary_folder() as folder:
            with self._named_in_errors(folder):
                yield folder
            with told(self.root, OutputError):
                system, there = store_of(self.root)
                for file in filter(Path.is_file, Path(folder).rglob("*")):
                    system.put_file(str(file), _object(there, file.relative_to(folder).as_posix()))

    @contextmanager
    def growing(self, name: str) -> Iterator[Growing]:
        """A file of the archive to which lines are added, in a bucket by one process at a time.

        Raises:
            LogError: what is there cannot be read. OutputError: the folder or a line cannot be written.
        """
        if not is_url(self.root):
            make_folder(self.root)
            yield Growing(os.path.join(self.root, name))
            return
        with self.reading([name]) as folder:
            path = os.path.join(folder, name)

            def publish() -> None:
                with told(self.root, OutputError):
                    system, there = store_of(self.root)
                    system.put_file(path, _object(there, name))

            try:
                yield Growing(path, publish)
            finally:
                publish()

    @contextmanager
    def _named_in_errors(self, folder: str) -> Iterator[None]:
        """Errors about files of a temporary folder name those of the archive."""
        try:
            yield
        except FtbiasError as error:
            if not error.file.startswith(folder):
                raise
            file = self.path(os.path.relpath(error.file, folder))
            raise type(error)(error.message, file=file, field=error.field, remedy=error.remedy) from error


def _object(there: str, name: str) -> str:
    return f"{there.rstrip('/')}/{name}"
