"""Budget of one file: bytes it may unpack to and records it may hold, checked before memory or time is spent.

A few kilobytes can declare, or really unpack to, any number of bytes. The limits of a file therefore depend on its
stored size. Decompression never yields more bytes than were declared, and refuses declarations that no log needs.
"""

import bz2
import importlib
import os
from typing import Any

from ftbias_jax.errors import LogError, OutputError, UsageError
from ftbias_jax.files import no_regular_file

MEMORY, MEMORY_VARIABLE = 1.0, "FTBIAS_MEMORY"
"""GiB of memory for reading and judging a log, and the environment variable that overrides it."""
COPIES = 3
"""Copies of a log's numbers in memory: as read, merged and cleaned, and while it is filtered or judged."""
MAX_BYTES = 16 << 30
"""Maximum bytes of the decoded numbers of one log: a day of seven joints and a wrench at 1 kHz are 15 GB in float64."""
MAX_RATIO = 100
"""Maximum ratio of unpacked to stored bytes over a whole file; measured logs, which have noise, stay below 20."""
SMALL = 256 << 20
"""Unpacked bytes that are accepted whatever the ratio: an arm at rest, all zeros or all NaN, compresses a
thousandfold."""
MAX_CHUNK = 256 << 20
"""Maximum unpacked bytes of a chunk or message of a recording; recorders write chunks of 1 MB, cameras of some 10
MB."""
SMALL_RECORDING = 64 << 20
"""Like SMALL, for all chunks and messages of a recording together."""
FEW_RECORDS = 200_000
"""Number of records that any recording may hold; reading these takes a second or two."""
LEAST_RECORD = 8
"""Minimum stored bytes per record in larger recordings: less than the smallest message takes, compressed."""

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_SECTOR = 512


def most_held() -> int:
    """Maximum bytes of numbers of a log held in memory, so that the stated memory suffices."""
    stated = os.environ.get(MEMORY_VARIABLE, str(MEMORY))
    try:
        gibibytes = float(stated)
    except ValueError:
        gibibytes = 0.0
    if not 0 < gibibytes < 1e6:
        raise UsageError(f"is {stated!r}", field=MEMORY_VARIABLE, remedy="give GiB, such as 4")
    return int(gibibytes * 2**30 / COPIES)


def refuse_held(count: int, file: str) -> None:
    """Refuse numbers that would take more than the stated memory."""
    if count > (most := most_held()):
        message = (
            f"has {count >> 20} MiB of numbers, and {COPIES * most / 2**30:.3g} GiB of memory are for {most >> 20} MiB"
        )
        remedy = (
            f"split it, save it as .npz for ftbias filter, which reads that in parts, or set {MEMORY_VARIABLE} in GiB"
        )
        raise LogError(message, file=file, remedy=remedy)


class Budget:
    """Remaining budget of one file; every method raises a LogError when it is exceeded."""

    def __init__(self, file: str | os.PathLike[str], small: int | None = None) -> None:
        self.file = os.fspath(file)
        try:
            kind, status = no_regular_file(file), os.stat(file)
        except OSError as error:
            raise LogError(f"cannot be read: {error.strerror}", file=self.file, remedy="check the path") from error
        if kind:
            raise LogError(kind, file=self.file, remedy="give a file")
        # A sparse file has fewer sectors than bytes; a few file systems count none at all.
        sectors = getattr(status, "st_blocks", 0) * _SECTOR
        self.size = status.st_size
        self.stored = min(status.st_size, sectors) if sectors else status.st_size
        self.limit = max(SMALL if small is None else small, MAX_RATIO * self.stored)
        if status.st_size > self.limit:
            message = f"has {status.st_size} bytes, of which {self.stored} are stored: the file is sparse"
            raise LogError(message, file=self.file, remedy="copy the log again")
        self.bytes, self.numbers, self.held = self.limit, min(MAX_BYTES, self.limit), 0
        self.records = max(FEW_RECORDS, self.stored // LEAST_RECORD)

    def hold(self, count: int, field: str = "") -> None:
        """Charge ``count`` bytes of numbers, which stay in memory until the log is read."""
        self.numbers -= count
        self.held += count
        if self.numbers < 0:
            message = f"declares more than {min(MAX_BYTES, self.limit)} bytes of numbers in {self.stored}"
            remedy = "that looks like a decompression bomb; write it again, or split the log"
            raise LogError(message, file=self.file, field=field, remedy=remedy)
        refuse_held(self.held, self.file)

    def unpack(self, count: int) -> None:
        """Charge ``count`` unpacked bytes, which are released before the next ones."""
        self.bytes -= count
        if self.bytes < 0:
            message = f"unpacks to more than {self.limit} bytes, {self.stored} are stored"
            raise LogError(message, file=self.file, remedy="that looks like a decompression bomb; unpack it yourself")

    def count(self, records: int = 1) -> None:
        """Charge records, or places that were searched for one."""
        self.records -= records
        if self.records < 0:
            message = f"holds too many records for its {self.stored} bytes"
            raise LogError(message, file=self.file, remedy="it is no recording, or is damaged beyond use")


class UnpackError(Exception):
    """The bytes are damaged, or unpack to another size than declared; the message is a clause of the caller's."""


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
    """Decompress what is left of a chunk whose end is missing, at most the bytes it declares."""
    if compression in ("", "none"):
        return packed[:size]
    size = min(size, MAX_CHUNK)
    budget.unpack(size)
    return _bounded(compression, packed, size)


def unpack_message(data: bytes, budget: Budget) -> bytes:
    """Decompress a message if rosbag2 has compressed it separately without marking it; CDR never starts like zstd."""
    if not data.startswith(ZSTD_MAGIC):
        return data
    most = min(MAX_CHUNK, budget.bytes)
    message = _bounded("zstd", data, most + 1)
    budget.unpack(len(message))
    if len(message) > MAX_CHUNK:
        raise UnpackError(f"unpacks to more than {MAX_CHUNK} bytes, which looks like a decompression bomb")
    return message


def need(module: str, extra: str, file: object = "", *, writes: bool = False) -> Any:
    """Import an optional dependency; if it is not installed, the remedy names the extra that includes it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        message = f"{'writing' if writes else 'reading'} it needs the package {module.partition('.')[0]}"
        remedy = f"pip install 'ftbias-jax[{extra}]'"
        raise (OutputError if writes else LogError)(message, file=file, remedy=remedy) from error


def _bounded(compression: str, packed: bytes, limit: int) -> bytes:
    """Decompress at most ``limit`` bytes."""
    try:
        if compression == "bz2":
            return bz2.BZ2Decompressor().decompress(packed, limit)
        if compression == "lz4":
            return bytes(need("lz4.frame", "ros").LZ4FrameDecompressor().decompress(packed, limit))
        if compression == "zstd":
            return bytes(need("zstandard", "ros").ZstdDecompressor().stream_reader(packed).read(limit))
    except LogError:
        raise
    except Exception as error:  # each of the three packages has its own exception, and lz4 raises RuntimeError
        raise UnpackError(f"cannot be unpacked: {error}") from error
    raise UnpackError(f"has the unknown compression {compression[:40]!r}")
