"""Arrays of untrusted NPZ and HDF5 files: sizes are checked before memory is allocated, and pickles are refused.

The arrays of an HDF5 file are its datasets, by their paths from the root.
"""

import math
import os
import tokenize
import zipfile
import zlib
from collections.abc import Callable, Collection, Iterator, Sequence, Set
from contextlib import contextmanager
from functools import partial
from typing import IO, Any, NamedTuple

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io import budget
from ftbias_jax.io.budget import MAX_CHUNK, Budget, need
from ftbias_jax.types import Array

GZIP, SHUFFLE, CHECKSUM, LZF = 1, 2, 3, 32000
"""Identifiers of HDF5's filters."""
MOST_DATASETS = 1000
"""Maximum number of datasets of one HDF5 file that are listed."""
GROWTH = 1 << 12
"""Bytes by which a stored chunk may exceed its unpacked size: noise does not compress, and filters add a little."""
_WRITE_AGAIN = "write it again with numpy.savez"
# What zipfile, zlib and numpy raise on damaged files; RuntimeError means encrypted, the last line a mangled header.
_DAMAGE = (
    *(OSError, EOFError, RuntimeError, zlib.error, MemoryError),
    *(ValueError, TypeError, OverflowError, SyntaxError, tokenize.TokenError),
)


def load_arrays(path: str | os.PathLike[str], wanted: Collection[str] | None = None) -> dict[str, Array]:
    """The arrays of an NPZ file by name: those of the wanted ones that it holds; None = all.

    A file that is damaged, would fill the memory, or holds Python objects is refused.
    """
    file = os.fspath(path)
    with _opened(file) as archive:
        members = {name: x for name, x in _members(archive).items() if wanted is None or name in wanted}
        if wanted is not None:
            budget.refuse_held(sum(member.file_size for member in members.values()), file)
        return {name: _read(archive, member, name, file) for name, member in members.items()}


class StoredArray(NamedTuple):
    """An array in a file, to be read in parts."""

    shape: tuple[int, ...]
    parts: Callable[[int], Iterator[Array]]
    """Rows per part -> iterator over the array in parts of that many rows; LogError if it is damaged."""


def stored_arrays(path: str | os.PathLike[str], wanted: Set[str] | None = None) -> dict[str, StoredArray]:
    """The wanted arrays that an NPZ file holds, without loading their numbers; None = all numeric arrays."""
    file, found = os.fspath(path), {}
    with _opened(file) as archive:
        for name, member in _members(archive).items():
            if wanted is not None and name not in wanted:
                continue
            with archive.open(member) as stream:
                shape, _, dtype = _check_header(stream, member, name, file, objects=wanted is None)
            if wanted is not None or dtype.kind in "fiu":
                found[name] = StoredArray(shape, partial(_parts, file, name))
    return found


def shapes_of_arrays(file: str) -> dict[str, tuple[int, ...]]:
    """The shapes of all numeric arrays in an NPZ file, by name."""
    return {name: stored.shape for name, stored in stored_arrays(file).items()}


def _parts(file: str, name: str, rows: int) -> Iterator[Array]:
    with _opened(file) as archive:
        member = _members(archive)[name]
        with archive.open(member) as stream:
            shape, in_columns, dtype = _check_header(stream, member, name, file)
            # An array that is stored column by column must be read whole to get its first row.
            whole = _read(archive, member, name, file) if in_columns else None
            for first in range(0, shape[0], rows):
                if whole is not None:
                    yield whole[first : first + rows]
                    continue
                count = min(rows, shape[0] - first)
                block = np.frombuffer(stream.read(count * math.prod(shape[1:]) * dtype.itemsize), dtype)
                yield block.reshape(count, *shape[1:])


@contextmanager
def _opened(file: str) -> Iterator[zipfile.ZipFile]:
    """The archive with its directory checked; exceptions while it is read are raised as LogError."""
    allowed = Budget(file)
    try:
        with zipfile.ZipFile(file) as archive:
            _check_directory(archive.infolist(), allowed, file)
            yield archive
    except zipfile.BadZipFile as error:
        raise LogError(f"is not an NPZ file, or is cut short: {error}", file=file, remedy=_WRITE_AGAIN) from error
    except _DAMAGE as error:
        words = getattr(error, "strerror", None) or error
        raise LogError(f"cannot be read: {words}", file=file, remedy="check the path and the file") from error


def _members(archive: zipfile.ZipFile) -> dict[str, zipfile.ZipInfo]:
    return {member.filename.removesuffix(".npy"): member for member in archive.infolist()}


def _check_directory(members: list[zipfile.ZipInfo], allowed: Budget, file: str) -> None:
    """Refuse a malicious or damaged directory by the names and sizes it declares, before anything is unpacked."""
    for member in members:
        name = member.filename
        if "/" in name or "\\" in name or ".." in name:
            raise LogError(f"unsafe array name {name!r}", file=file, remedy="name arrays without slashes and '..'")
        if member.compress_size > allowed.size:
            raise LogError("is larger than the file it is in", file=file, field=name, remedy=_WRITE_AGAIN)
        if member.file_size > max(budget.SMALL, budget.MAX_RATIO * member.compress_size):
            remedy = f"more than {budget.MAX_RATIO} times looks like a decompression bomb; {_WRITE_AGAIN}"
            raise LogError(f"unpacks to {member.file_size} bytes", file=file, field=name, remedy=remedy)
    if len({member.filename for member in members}) < len(members):
        raise LogError("has two arrays of one name", file=file, remedy=_WRITE_AGAIN)
    total = sum(member.file_size for member in members)
    limit = min(budget.MAX_BYTES, allowed.limit)
    if total > limit:
        remedy = f"the limit is {limit} bytes; split the log"
        raise LogError(f"declares {total} bytes of arrays", file=file, remedy=remedy)


def _read(archive: zipfile.ZipFile, member: zipfile.ZipInfo, name: str, file: str) -> Array:
    with archive.open(member) as stream:
        _check_header(stream, member, name, file)
    with archive.open(member) as stream:
        return np.lib.format.read_array(stream, allow_pickle=False)


def _check_header(
    stream: IO[bytes], member: zipfile.ZipInfo, name: str, file: str, objects: bool = False
) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, storage order and type from the array's header, which must declare exactly the bytes of the member.

    Python objects, which are never read, are refused here unless ``objects`` is set.
    """
    npy = np.lib.format
    version, readers = npy.read_magic(stream), {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    if version not in readers:  # 3.0 exists for structured arrays with non-Latin field names, which no log has
        raise LogError(f"has NPY version {version}", file=file, field=name, remedy="save plain arrays of numbers")
    shape, in_columns, dtype = readers[version](stream)
    if dtype.hasobject:
        if objects:
            return shape, in_columns, dtype
        raise LogError("holds Python objects", file=file, field=name, remedy="save plain arrays of numbers")
    promised = stream.tell() + math.prod(shape) * dtype.itemsize
    if promised != member.file_size:
        message = f"its header promises {promised} bytes, the file has {member.file_size}"
        raise LogError(message, file=file, field=name, remedy=_WRITE_AGAIN)
    return shape, in_columns, dtype


def load_hdf5(file: str, names: Sequence[str]) -> dict[str, Array]:
    """The datasets of these names that exist, after checking their sizes against the file's budget."""
    with _opened_hdf5(file) as (h5py, root, budget):
        there = [name for name in names if _is_there(h5py, root, name, file)]
        datasets = {x: _dataset(h5py, root, x, file) for x in there if not isinstance(root[x], h5py.Group)}
        for name, dataset in datasets.items():
            budget.hold(dataset.size * 8, name)
        for name, dataset in datasets.items():
            _check_chunks(dataset, budget, file, name)
        return {name: np.asarray(dataset[()]) for name, dataset in datasets.items()}


def shapes_of_hdf5(file: str) -> dict[str, tuple[int, ...]]:
    """The shapes of all numeric datasets, by their paths; links are not followed."""
    found: dict[str, tuple[int, ...]] = {}
    with _opened_hdf5(file) as (h5py, root, _):

        def visit(name: str, item: Any) -> bool | None:
            if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiu" and item.shape is not None:
                found[name] = item.shape
            return True if len(found) == MOST_DATASETS else None  # ends the visit

        root.visititems(visit)
    return found


@contextmanager
def _opened_hdf5(file: str) -> Iterator[tuple[Any, Any, Budget]]:
    """h5py, the root of the file and its budget; exceptions of the library are raised as LogError."""
    h5py, budget = need("h5py", "hdf5", file), Budget(file)  # the budget also checks that it is a file
    try:
        with open(file, "rb"):  # raises the system's own error for a file that cannot be read
            pass
        with h5py.File(file, "r") as root:
            yield h5py, root, budget
    except LogError:
        raise
    except OSError as error:
        words = error.strerror or str(error).partition("(")[2].rstrip(")") or error
        raise LogError(f"cannot be read: {words}", file=file, remedy="check the path and the file") from error
    except Exception as error:  # h5py turns what the C library reports into many types, RuntimeError among them
        raise LogError(f"is damaged: {error}", file=file, remedy="write it again") from error


def _is_there(h5py: Any, root: Any, path: str, file: str) -> bool:
    """Whether there is anything at a path; a link on the way to it is refused."""
    steps = path.split("/")
    for i in range(len(steps)):
        link = root.get("/".join(steps[: i + 1]), getlink=True)
        if link is None:
            return False
        if not isinstance(link, h5py.HardLink):
            raise LogError("is a link", file=file, field=path, remedy="store the dataset itself")
    return True


def _dataset(h5py: Any, root: Any, name: str, file: str) -> Any:
    """The dataset of this name, which must be numeric and stored in this file."""
    dataset = root[name]
    if not isinstance(dataset, h5py.Dataset) or dataset.dtype.kind not in "fiu" or dataset.shape is None:
        raise LogError("is no dataset of numbers", file=file, field=name, remedy="store arrays of real numbers")
    if dataset.is_virtual or dataset.external:
        raise LogError("is stored in another file", file=file, field=name, remedy="store the dataset itself")
    return dataset


def _check_chunks(dataset: Any, budget: Budget, file: str, name: str) -> None:
    """Refuse a dataset of h5py whose chunks unpack to more bytes than their shape allows."""
    if dataset.chunks is None:
        return
    room = math.prod(dataset.chunks) * dataset.dtype.itemsize
    if room > MAX_CHUNK:
        remedy = f"the limit is {MAX_CHUNK}; write it again with smaller ones"
        raise LogError(f"has chunks of {room} bytes", file=file, field=name, remedy=remedy)
    properties = dataset.id.get_create_plist()
    filters = [properties.get_filter(i)[0] for i in range(properties.get_nfilters())]
    packed = [kind for kind in filters if kind not in (SHUFFLE, CHECKSUM)]
    if packed not in ([], [GZIP], [LZF]):
        remedy = "write it again with gzip, lzf or without compression"
        raise LogError(f"is compressed by the filters {packed}", file=file, field=name, remedy=remedy)
    chunks: list[Any] = []
    dataset.id.chunk_iter(chunks.append)
    for stored in chunks:
        budget.count()
        budget.unpack(room)
        if stored.size > room + GROWTH or (packed == [GZIP] and _grows(dataset, stored.chunk_offset, room)):
            message = f"has a chunk of {stored.size} bytes that unpacks to more than the {room} of its shape"
            raise LogError(message, file=file, field=name, remedy="it is damaged, or a decompression bomb")


def _grows(dataset: Any, offset: tuple[int, ...], room: int) -> bool:
    """Whether a gzip chunk unpacks to more bytes than its shape allows."""
    mask, packed = dataset.id.read_direct_chunk(offset)
    if mask:  # some filters were skipped for this chunk: its content cannot exceed its stored bytes
        return len(packed) > room + GROWTH
    try:
        return len(zlib.decompressobj().decompress(packed, room + GROWTH + 1)) > room + GROWTH
    except zlib.error:
        return False  # the library reports this when it reads the chunk
