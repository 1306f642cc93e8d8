"""Recordings of ROS for the tests, written by the package rosbags, which shares no code with the readers."""

import sqlite3
import struct
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

FORMATS = {
    "ros1": "log.bag",
    "ros1 bz2": "log.bag",
    "ros1 lz4": "log.bag",
    "sqlite": "log/log.db3",
    "sqlite zstd messages": "log/log.db3",
    "sqlite zstd file": "log",
    "mcap": "log/log.mcap",
    "mcap zstd chunks": "log/log.mcap",
    "folder": "log",
}
SECOND = 10**9
START = 1_700_000_000 * SECOND + 123_456_789


class Joints(NamedTuple):
    """A sensor_msgs/JointState."""

    stamp: int
    names: tuple
    position: tuple
    velocity: tuple = ()
    topic: str = "/joint_states"
    logged: int | None = None
    publisher: str = "arm"


class Wrench(NamedTuple):
    """A geometry_msgs/WrenchStamped."""

    stamp: int
    wrench: tuple
    topic: str = "/wrench"
    logged: int | None = None
    frame: str = "ft_sensor"
    publisher: str = "sensor"


class Pose(NamedTuple):
    """A geometry_msgs/PoseStamped, or with a child's name a transform in a tf2_msgs/TFMessage."""

    stamp: int
    names: tuple
    pose: tuple
    topic: str = "/pose"
    logged: int | None = None
    publisher: str = "arm"


class Text(NamedTuple):
    """A std_msgs/String."""

    stamp: int
    text: str
    topic: str = "/robot_description"
    logged: int | None = None
    publisher: str = "state_publisher"


class Other(NamedTuple):
    """A message of any type, from a dict of its fields; omitted ones are zero."""

    stamp: int
    kind: str
    fields: dict
    topic: str
    logged: int | None = None
    publisher: str = "other"
    types: Mapping = MappingProxyType({})
    """Name -> definition of the types that ROS does not have."""


def arrays(samples=60, seed=0):
    """A log of the arm base, elbow: joints at 50 Hz, a wrench at 100 Hz, ns."""
    rng = np.random.default_rng(seed)
    t = START + np.arange(samples) * SECOND // 100
    return {
        "t_joints": t[::2],
        "q": rng.normal(size=(len(t[::2]), 2)),
        "dq": rng.normal(size=(len(t[::2]), 2)),
        "t_wrench": t,
        "wrench": rng.normal(size=(samples, 6)),
    }


def messages(log=None, names=("base", "elbow")):
    """The messages of ``arrays()``, in the order of their stamps."""
    log = log or arrays()
    joints = [
        Joints(int(t), names, tuple(q), tuple(v)) for t, q, v in zip(log["t_joints"], log["q"], log["dq"], strict=True)
    ]
    wrenches = [Wrench(int(t), tuple(w)) for t, w in zip(log["t_wrench"], log["wrench"], strict=True)]
    return sorted([*joints, *wrenches], key=lambda message: message.stamp)


def write(folder: Path, kind: str, published) -> Path:
    """Write messages in one of FORMATS; returns the path to give to a reader."""
    if kind.startswith("ros1"):
        writer = rosbag1.Writer(folder / "log.bag")
        if " " in kind:
            writer.set_compression(rosbag1.Writer.CompressionFormat[kind.split()[1].upper()])
        _write(writer, get_typestore(Stores.ROS1_NOETIC), "serialize_ros1", published)
        return folder / FORMATS[kind]
    plugin = rosbag2.StoragePlugin.MCAP if "mcap" in kind else rosbag2.StoragePlugin.SQLITE3
    writer = rosbag2.Writer(folder / "log", version=9, storage_plugin=plugin)
    if "zstd" in kind:
        mode = {"messages": "MESSAGE", "file": "FILE", "chunks": "STORAGE"}[kind.split()[-1]]
        writer.set_compression(rosbag2.CompressionMode[mode], rosbag2.CompressionFormat.ZSTD)
    _write(writer, get_typestore(Stores.ROS2_JAZZY), "serialize_cdr", published)
    return folder / FORMATS[kind]


def _write(writer, store, serialize, published):
    connections = {}
    published = list(published)
    own = {name: text for message in published for name, text in getattr(message, "types", {}).items()}
    for name, text in own.items():
        store.register(get_types_from_msg(text, name))
    with writer:
        for i, message in enumerate(published):
            kind, fields, frame = _described(message)
            # Only ROS 1 stores the publisher of a message.
            key = (message.topic, message.publisher if serialize == "serialize_ros1" else "")
            if key not in connections:
                options = {"callerid": message.publisher} if serialize == "serialize_ros1" else {}
                connections[key] = writer.add_connection(message.topic, kind, typestore=store, **options)
            logged = message.logged if message.logged is not None else message.stamp + 1000
            content = filled(store, kind, fields, header(store, message.stamp, frame, i))
            writer.write(connections[key], logged, getattr(store, serialize)(content, kind))


def forget_definitions(path: Path) -> None:
    """Make a bag as ROS 2 Humble and older ones write it."""
    with closing(sqlite3.connect(path)) as database:
        database.execute("DROP TABLE message_definitions")
        database.commit()


def bag_of(*records):
    """A ROS 1 bag of (header fields, data), as bytes."""
    return b"#ROSBAG V2.0\n" + b"".join(bag_record(*record) for record in records)


def bag_record(fields, data):
    header = b"".join(struct.pack("<I", len(field)) + field for field in fields)
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data


def filled(store, name, fields, header):
    """An object of a type with these fields; the other fields are zero."""
    kind = store.types[name]
    values = []
    for field, (node, described) in store.get_msgdef(name).fields:
        given = fields.get(field)
        if name == "std_msgs/msg/Header":
            return header
        if node == Nodetype.NAME:
            values.append(filled(store, described, _by_name(store, described, given), header))
        elif node == Nodetype.BASE:
            values.append(given if given is not None else "" if described[0] == "string" else 0)
        elif described[0][0] == Nodetype.NAME:
            values.append([filled(store, described[0][1], one, header) for one in given or ()])
        elif described[0][1][0] == "string":
            values.append(list(given or ()))
        else:
            length = described[1] if node == Nodetype.ARRAY else 0
            values.append(np.zeros(length) if given is None else np.asarray(given, described[0][1][0]))
    return kind(*values)


def _by_name(store, name, given):
    """The fields of a type from a dict or a tuple."""
    if isinstance(given, tuple):
        return dict(zip((field for field, _ in store.get_msgdef(name).fields), given, strict=True))
    return given or {}


def _described(message):
    """Type, fields and frame of a message."""
    match message:
        case Text():
            return "std_msgs/msg/String", {"data": message.text}, ""
        case Joints():
            fields = {"name": message.names, "position": message.position, "velocity": message.velocity}
            return "sensor_msgs/msg/JointState", fields, ""
        case Wrench():
            wrench = {"force": message.wrench[:3], "torque": message.wrench[3:]}
            return "geometry_msgs/msg/WrenchStamped", {"wrench": wrench}, message.frame
        case Pose(names=[frame]):
            pose = {"position": message.pose[:3], "orientation": message.pose[3:]}
            return "geometry_msgs/msg/PoseStamped", {"pose": pose}, frame
        case Pose(names=[frame, child]):
            moved = {"translation": message.pose[:3], "rotation": message.pose[3:]}
            return "tf2_msgs/msg/TFMessage", {"transforms": [{"child_frame_id": child, "transform": moved}]}, frame
    return message.kind, message.fields, "somewhere"


def header(store, stamp, frame, i):
    """The header of message number i, of a time in ns."""
    kind = store.types["std_msgs/msg/Header"]
    numbered = [i] if "seq" in kind.__dataclass_fields__ else []
    return kind(*numbered, store.types["builtin_interfaces/msg/Time"](*divmod(stamp, SECOND)), frame)
