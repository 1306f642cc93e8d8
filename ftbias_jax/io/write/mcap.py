"""Results as MCAP files of geometry_msgs/msg/WrenchStamped, which Foxglove and PlotJuggler plot without any setting."""

from __future__ import annotations

import importlib
import os
import struct
from collections.abc import Mapping
from typing import BinaryIO

import numpy as np

from ftbias_jax.errors import OutputError
from ftbias_jax.io.atomic import write_atomic
from ftbias_jax.io.write.provenance import Provenance, as_text
from ftbias_jax.types import Array

TOPICS = ("wrench_unbiased", "bias", "bias_std", "bias_smooth", "wrench_tool", "innovation")
"""Arrays (T, 6) that become the topic /ftbias/NAME, where they are there."""
FRAME = "ft_sensor"

_SEPARATOR = "=" * 80 + "\nMSG: "
SCHEMA = _SEPARATOR.join(
    [
        "std_msgs/Header header\nWrench wrench\n",
        "std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n",
        "builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n",
        "geometry_msgs/Wrench\nVector3 force\nVector3 torque\n",
        "geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n",
    ]
)


def save_mcap(
    path: str | os.PathLike[str],
    arrays: Mapping[str, Array],
    start: float = 0.0,
    frame: str = FRAME,
    origin: Provenance | None = None,
) -> None:
    """Write the corrected wrench, the bias and what else is there as topics.

    Args:
        path: the file.
        arrays: t (T,) s, and (T, 6) arrays of TOPICS, N and Nm, signs as in the report.
        start: s, added to t.
        frame: of the sensor, for the headers.
        origin: what they were made from, kept in the metadata record ``ftbias``.

    Raises:
        OutputError: the file cannot be written, the package mcap is not installed, or a stamp is not within 0 and the
            year 2106.
    """
    try:
        writers = importlib.import_module("mcap.writer")
    except ImportError as error:
        remedy = "pip install 'ftbias-jax[ros]'"
        raise OutputError("writing it needs the package mcap", file=path, remedy=remedy) from error
    stamps = round(start * 1e9) + np.rint(np.asarray(arrays["t"]) * 1e9).astype(np.int64)
    if not ((stamps >= 0) & (stamps < 2**32 * 10**9)).all():
        message = f"stamps from {stamps.min()} to {stamps.max()} ns do not fit a ROS header"
        raise OutputError(message, file=path, remedy="write another format, or stamp the log with times since 1970")
    topics = {name: np.asarray(arrays[name], np.float64) for name in TOPICS if name in arrays}

    def write(file: BinaryIO) -> None:
        writer = writers.Writer(file)
        writer.start(profile="ros2", library="ftbias_jax")
        schema = writer.register_schema("geometry_msgs/msg/WrenchStamped", "ros2msg", SCHEMA.encode())
        channels = [writer.register_channel(f"/ftbias/{name}", "cdr", schema) for name in topics]
        for i, stamp in enumerate(stamps.tolist()):
            for channel, wrenches in zip(channels, topics.values(), strict=True):
                writer.add_message(channel, stamp, wrench_message(stamp, frame, wrenches[i]), stamp)
        if origin is not None:
            writer.add_metadata("ftbias", {"provenance": as_text(origin)})
        writer.finish()

    write_atomic(path, write)


def wrench_message(stamp: int, frame: str, wrench: Array) -> bytes:
    """The bytes (CDR, little endian) of a geometry_msgs/msg/WrenchStamped.

    Args:
        stamp: ns.
        frame: its name.
        wrench: (6,) N, Nm.
    """
    seconds, nanoseconds = divmod(stamp, 10**9)
    name = frame.encode() + b"\x00"
    padding = -(12 + len(name)) % 8  # the numbers are aligned to eight bytes after the first four
    body = struct.pack(f"<III{len(name)}s{padding}x6d", seconds, nanoseconds, len(name), name, *wrench)
    return b"\x00\x01\x00\x00" + body
