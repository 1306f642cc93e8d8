"""Logs as HDF5 files: datasets with the names of the native format, at the root."""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.limits.budget import MAX_CHUNK, Budget, need
from ftbias_jax.types import Array

GZIP, SHUFFLE, CHECKSUM, LZF = 1, 2, 3, 32000
"""Numbers of HDF5's filters."""
GROWTH = 1 << 12
"""Bytes that a chunk may be longer stored than unpacked: noise does not compress, and filters add a little."""


def load_hdf5(file: str, names: Sequence[str]) -> dict[str, Array]:
    """The datasets of these names that are there, none of which takes more than it may."""
    h5py = need("h5py", "hdf5", file)
    budget = Budget(file)
    try:
        with open(file, "rb"):  # the system's own words for a file that may not be read
            pass
        with h5py.File(file, "r") as root:
            datasets = {name: _dataset(h5py, root, name, file) for name in names if name in root}
            for name, dataset in datasets.items():
                budget.hold(dataset.size * 8, name)
            for name, dataset in datasets.items():
                _check_chunks(dataset, budget, file, name)
            return {name: np.asarray(dataset[()]) for name, dataset in datasets.items()}
    except LogError:
        raise
    except OSError as error:
        words = error.strerror or str(error).partition("(")[2].rstrip(")") or error
        raise LogError(f"cannot be read: {words}", file=file, remedy="check the path and the file") from error
    except Exception as error:  # h5py turns what the C library reports into many types, RuntimeError among them
        raise LogError(f"is damaged: {error}", file=file, remedy="write it again") from error


def _dataset(h5py: Any, root: Any, name: str, file: str) -> Any:
    """The dataset of this name, if its numbers are in this very file and as many as it has room for."""
    if not isinstance(root.get(name, getlink=True), h5py.HardLink):
        raise LogError("is a link", file=file, field=name, remedy="store the dataset itself at the root")
    dataset = root[name]
    if not isinstance(dataset, h5py.Dataset) or dataset.dtype.kind not in "fiu" or dataset.shape is None:
        raise LogError("is no dataset of numbers", file=file, field=name, remedy="store arrays of real numbers")
    if dataset.is_virtual or dataset.external:
        raise LogError("is stored in another file", file=file, field=name, remedy="store the dataset itself")
    return dataset


def _check_chunks(dataset: Any, budget: Budget, file: str, name: str) -> None:
    """Refuse a dataset of h5py whose chunks unpack to more than their shape has room for."""
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
    """Whether a chunk of gzip unpacks to more than its room."""
    mask, packed = dataset.id.read_direct_chunk(offset)
    if mask:  # some filters were left out: what is left cannot be more than the chunk as it is stored
        return len(packed) > room + GROWTH
    try:
        return len(zlib.decompressobj().decompress(packed, room + GROWTH + 1)) > room + GROWTH
    except zlib.error:
        return False  # the library says so when it reads it
