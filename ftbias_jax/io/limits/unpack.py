"""Decompression that never yields more bytes than were declared, and refuses declarations that no log needs."""

from __future__ import annotations

import bz2
import importlib
from typing import Any

from ftbias_jax.errors import LogError, OutputError
from ftbias_jax.io.limits.budget import MAX_CHUNK, Budget

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


class UnpackError(Exception):
    """The bytes are damaged, or unpack to another size than declared; the message is a clause for ours."""


def unpack(compression: str, packed: bytes, size: int, budget: Budget) -> bytes:
    """Decompress one chunk."""
    if compression in ("", "none"):
        unpacked = packed
    elif size > MAX_CHUNK:
        raise UnpackError(f"declares {size} bytes in {len(packed)}, which looks like a decompression bomb")
    else:
        budget.unpack(size)
        unpacked = _bounded(compression, packed, size + 1)
    if len(unpacked) != size:
        count = f"more than {size}" if len(unpacked) > size else len(unpacked)
        raise UnpackError(f"unpacks to {count} bytes, but declares {size}")
    return unpacked


def unpack_cut(compression: str, packed: bytes, size: int, budget: Budget) -> bytes:
    """What can be had of a chunk whose end is missing, at most the bytes it declares."""
    if compression in ("", "none"):
        return packed[:size]
    size = min(size, MAX_CHUNK)
    budget.unpack(size)
    return _bounded(compression, packed, size)


def unpack_message(data: bytes, budget: Budget) -> bytes:
    """The message itself, which rosbag2 may have compressed alone without saying so; CDR never starts like zstd."""
    if not data.startswith(ZSTD_MAGIC):
        return data
    most = min(MAX_CHUNK, budget.bytes)
    message = _bounded("zstd", data, most + 1)
    budget.unpack(len(message))
    if len(message) > MAX_CHUNK:
        raise UnpackError(f"unpacks to more than {MAX_CHUNK} bytes, which looks like a decompression bomb")
    return message


def need(module: str, extra: str, file: object = "", *, writes: bool = False) -> Any:
    """An optional dependency, imported; if it is not installed, the remedy names the extra that brings it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        message = f"{'writing' if writes else 'reading'} it needs the package {module.partition('.')[0]}"
        remedy = f"pip install 'ftbias-jax[{extra}]'"
        raise (OutputError if writes else LogError)(message, file=file, remedy=remedy) from error


def _bounded(compression: str, packed: bytes, limit: int) -> bytes:
    """At most ``limit`` bytes of what is packed."""
    try:
        if compression == "bz2":
            return bz2.BZ2Decompressor().decompress(packed, limit)
        if compression == "lz4":
            return bytes(need("lz4.frame", "ros").LZ4FrameDecompressor().decompress(packed, limit))
        if compression == "zstd":
            return bytes(need("zstandard", "ros").ZstdDecompressor().stream_reader(packed).read(limit))
    except LogError:
        raise
    except Exception as error:  # the three packages have an exception each, and lz4 raises plain RuntimeError
        raise UnpackError(f"cannot be unpacked: {error}") from error
    raise UnpackError(f"has the unknown compression {compression[:40]!r}")
