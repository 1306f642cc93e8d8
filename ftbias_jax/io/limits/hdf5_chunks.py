"""Chunks of HDF5 datasets, which its library unpacks to whatever they hold: here no further than they may."""

from __future__ import annotations

import math
import zlib
from typing import Any

from ftbias_jax.errors import LogError
from ftbias_jax.io.limits.budget import MAX_CHUNK, Budget

GZIP, SHUFFLE, CHECKSUM, LZF = 1, 2, 3, 32000
"""Numbers of HDF5's filters."""
GROWTH = 1 << 12
"""Bytes that a chunk may be longer stored than unpacked: noise does not compress, and filters add a little."""


def check_chunks(dataset: Any, budget: Budget, file: str, name: str) -> None:
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
