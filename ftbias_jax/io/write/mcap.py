"""Results as MCAP files of geometry_msgs/msg/WrenchStamped, and layouts of viewers for their topics.

Foxglove and PlotJuggler plot the files without any setting, and with a layout all topics together.
"""

import os
import struct
from collections.abc import Mapping
from importlib import resources
from typing import BinaryIO

import numpy as np

from ftbias_jax.errors import OutputError
from ftbias_jax.io.atomic import write_atomic
from ftbias_jax.io.budget import need
from ftbias_jax.io.write.fields import FIELDS, SIGN
from ftbias_jax.io.write.selection import About, texts_of
from ftbias_jax.types import Array

TOPICS = (
    *("wrench_unbiased", "bias", "bias_std", "bias_smooth", "wrench_tool", "innovation"),
    *("contact_wrench", "contact_wrench_std"),
)
"""Arrays (T, 6) that become the topic /ftbias/NAME, if they are present."""
FLAGS = ("used", "in_contact")
"""Arrays (T,) of booleans that become such topics, as std_msgs/msg/Bool."""
FRAME = "ft_sensor"
"""Frame in the headers if the log names none."""

CDR = b"\x00\x01\x00\x00"
"""First bytes of a CDR message: little endian."""


def schema_with_header(message: str, *parts: str) -> str:
    """Definition of a ROS 2 message with a header, and of its other parts, each beginning with its name."""
    header = (
        "std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n",
        "builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n",
    )
    return ("=" * 80 + "\nMSG: ").join((message, *header, *parts))


SCHEMA = schema_with_header(
    f"# {SIGN}\nstd_msgs/Header header\nWrench wrench\n",
    "geometry_msgs/Wrench\nVector3 force  # N\nVector3 torque  # Nm, about the sensor's origin\n",
    "geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n",
)
FLAG_SCHEMA = "bool data\n"


def save_mcap(path: str | os.PathLike[str], arrays: Mapping[str, Array], about: About) -> None:
    """Write the corrected wrench, the bias and the other arrays that are present as topics.

    The arrays are t (T,) s by the log's clock, (T, 6) arrays of TOPICS, N and Nm, signs as in the report, and (T,)
    arrays of FLAGS. ``about`` is stored in the metadata record ``ftbias`` (``about``, ``provenance``), its frame in the
    headers; every channel has ``unit``, ``meaning`` and ``sign`` in its own metadata.
    """
    frame = about.frame or FRAME
    writers = need("mcap.writer", "ros", path, writes=True)
    stamps = np.rint(np.asarray(arrays["t"]) * 1e9).astype(np.int64)
    if not ((stamps >= 0) & (stamps < 2**32 * 10**9)).all():
        message = f"stamps from {stamps.min()} to {stamps.max()} ns do not fit a ROS header"
        raise OutputError(message, file=path, remedy="write another format, or stamp the log with times since 1970")
    topics = {name: np.asarray(arrays[name], np.float64) for name in TOPICS if name in arrays}
    flags = {name: np.asarray(arrays[name], bool) for name in FLAGS if name in arrays}

    def write(file: BinaryIO) -> None:
        writer = writers.Writer(file)
        writer.start(profile="ros2", library="ftbias_jax")
        schema = writer.register_schema("geometry_msgs/msg/WrenchStamped", "ros2msg", SCHEMA.encode())
        channels = {name: writer.register_channel(topic(name), "cdr", schema, _words(name)) for name in topics}
        if flags:
            schema = writer.register_schema("std_msgs/msg/Bool", "ros2msg", FLAG_SCHEMA.encode())
        channels |= {name: writer.register_channel(topic(name), "cdr", schema, _words(name)) for name in flags}
        for i, stamp in enumerate(stamps.tolist()):
            messages = {name: wrench_message(stamp, frame, wrenches[i]) for name, wrenches in topics.items()}
            messages |= {name: CDR + bytes([bool(truths[i])]) for name, truths in flags.items()}
            for name, message in messages.items():
                writer.add_message(channels[name], stamp, message, stamp)
        writer.add_metadata("ftbias", texts_of(arrays, about))
        writer.finish()

    write_atomic(path, write)


def topic(name: str) -> str:
    """The topic of an array."""
    return f"/ftbias/{name}"


def _words(name: str) -> dict[str, str]:
    """The metadata of a channel."""
    return {"unit": FIELDS[name].unit, "meaning": FIELDS[name].meaning, "sign": SIGN}


def wrench_message(stamp: int, frame: str, wrench: Array) -> bytes:
    """The bytes (CDR, little endian) of a geometry_msgs/msg/WrenchStamped, from ns, frame and wrench (6,) N, Nm."""
    seconds, nanoseconds = divmod(stamp, 10**9)
    name = frame.encode() + b"\x00"
    padding = -(12 + len(name)) % 8  # the numbers are aligned to eight bytes after the first four
    body = struct.pack(f"<III{len(name)}s{padding}x6d", seconds, nanoseconds, len(name), name, *wrench)
    return CDR + body


LAYOUTS = {"foxglove": "foxglove.json", "plotjuggler": "plotjuggler.xml"}
"""Program -> its layout, as the program itself exports it: for "Import from file" of Foxglove, "Load layout" of
PlotJuggler."""


def layout(program: str) -> str:
    """Text of the layout for the topics of a result; plots of topics that a file lacks stay empty."""
    return resources.files(__package__ or "").joinpath("layouts", LAYOUTS[program]).read_text(encoding="utf-8")
