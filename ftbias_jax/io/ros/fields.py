"""Reading of numbers from messages of any type by field path, such as ``wrench.force`` or ``tau[0:6]``."""

import importlib
import re
import struct
from collections.abc import Sequence
from typing import Any, NamedTuple

from ftbias_jax.errors import LogError
from ftbias_jax.io.ros.definition import HEADER, PRIMITIVES, SEQUENCE, TEXTS, Field, Types, parse, smallest
from ftbias_jax.io.ros.messages import Cursor, MessageError, Reading
from ftbias_jax.io.ros.raw import Definition
from ftbias_jax.setup.fields import nearest

MAX_VALUES = 1000
"""Maximum number of values read from one message."""
_PART = re.compile(r"([A-Za-z]\w*)(?:\[(\d{1,6})?(:)?(\d{1,6})?\])?")
_VECTOR = "float64 x\nfloat64 y\nfloat64 z"
COMMON = {
    "geometry_msgs/Vector3": _VECTOR,
    "geometry_msgs/Quaternion": f"{_VECTOR}\nfloat64 w",
    "geometry_msgs/Wrench": "Vector3 force\nVector3 torque",
    "geometry_msgs/WrenchStamped": "std_msgs/Header header\nWrench wrench",
    "geometry_msgs/Accel": "Vector3 linear\nVector3 angular",
    "geometry_msgs/AccelStamped": "std_msgs/Header header\nAccel accel",
    "geometry_msgs/AccelWithCovariance": "Accel accel\nfloat64[36] covariance",
    "geometry_msgs/AccelWithCovarianceStamped": "std_msgs/Header header\nAccelWithCovariance accel",
    "sensor_msgs/Temperature": "std_msgs/Header header\nfloat64 temperature\nfloat64 variance",
    "sensor_msgs/Imu": "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\n"
    "float64[9] orientation_covariance\ngeometry_msgs/Vector3 angular_velocity\n"
    "float64[9] angular_velocity_covariance\ngeometry_msgs/Vector3 linear_acceleration\n"
    "float64[9] linear_acceleration_covariance",
    "sensor_msgs/JointState": "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n"
    "float64[] effort",
    "std_msgs/Float64": "float64 data",
    "std_msgs/Float32": "float32 data",
}
"""Definitions for recordings that hold none: SQLite bags hold them only since ROS 2 Iron."""
_RULE = "\n" + "=" * 80 + "\n"
STORES = ("ROS2_HUMBLE", "LATEST")
"""Type stores of the package rosbags, which is consulted for other types of ROS 2, if it is installed."""

Path = tuple[tuple[str, slice], ...]
"""Field names from the message inwards, and the entries of each (all by default); () = the message itself."""


class Plan(NamedTuple):
    """Plan for reading some fields from every message of a type."""

    types: Types
    root: str
    least: dict[str, int]
    """Type -> the minimum number of bytes that it takes."""
    paths: tuple[Path, ...]


def parse_paths(text: str) -> tuple[Path, ...]:
    """Parse paths separated by commas; "" = the message itself."""
    return tuple(tuple(_part(word.strip()) for word in path.split(".") if path.strip()) for path in text.split(","))


def _part(word: str) -> tuple[str, slice]:
    found = _PART.fullmatch(word)
    if found is None or "[]" in word:
        raise LogError(f"{word[:40]!r} is no field", remedy="write names with dots between them: state.tau[0:6]")
    _, first, colon, last = found.groups()
    if first is None and last is None:
        return found[1], slice(None)
    start = int(first or 0)
    return found[1], slice(start, int(last) if last else None) if colon else slice(start, start + 1)


def make_plan(types: Types, root: str, text: str) -> Plan:
    """Plan for reading the fields at the paths ``text``.

    Raises:
        MessageError: the types are invalid. LogError: they have no such path; the error names no file.
    """
    least = smallest(types, root)
    paths = parse_paths(text)
    for path in paths:
        kind = root
        for name, chosen in path:
            fields = {field.name: field for field in types.get(kind, ())}
            if name not in fields:
                raise LogError(f"{kind} has no field {name!r}", remedy=nearest(name, fields))
            if fields[name].length is None and chosen != slice(None):
                raise LogError(f"{name!r} of {kind} is no list", remedy="leave the brackets out")
            kind = fields[name].type
        if kind in TEXTS:
            raise LogError(f"{path[-1][0]!r} is text", remedy="name a field of numbers")
    # A type may have any number of fields that take no bytes, which must not be iterated over.
    kept = {
        name: tuple(x for x in types[name] if x.length == SEQUENCE or (x.length != 0 and least.get(x.type) != 0))
        for name in least
    }
    return Plan(kept, root, least, paths)


def take(plan: Plan, data: bytes, encoding: str) -> Reading:
    """Read the wanted numbers of one message, path by path.

    Raises:
        MessageError: the message is damaged, or has too many wanted numbers.
    """
    cursor = Cursor(data, encoding)
    if len(data) < plan.least[plan.root]:
        raise MessageError(f"is damaged: {len(data)} bytes, at least {plan.least[plan.root]} are needed")
    try:
        stamp, frame = 0, ""
        fields = plan.types[plan.root]
        if fields and fields[0].type == HEADER and fields[0].length is None:
            stamp, frame = Cursor(data, encoding).header()
        found: list[list[float]] = [[] for _ in plan.paths]
        _walk(plan, cursor, plan.root, list(zip(plan.paths, found, strict=True)))
    except (struct.error, UnicodeDecodeError, IndexError) as error:
        raise MessageError(f"is damaged: {error}") from error
    values = tuple(value for numbers in found for value in numbers)
    if len(values) > MAX_VALUES:
        raise MessageError(f"has {len(values)} numbers in the fields that are wanted")
    return Reading(stamp, (frame,), values)


_Wanted = Sequence[tuple[Path, list[float]]]


def _walk(plan: Plan, cursor: Cursor, kind: str, wanted: _Wanted) -> None:
    """Read a value of a type and collect the wanted numbers; nothing is read after the last wanted field."""
    fields = plan.types[kind]
    of_field = [[(path, out) for path, out in wanted if not path or path[0][0] == field.name] for field in fields]
    last = max((i for i, some in enumerate(of_field) if some), default=-1) if kind == plan.root else len(fields)
    for field, some in zip(fields[: last + 1], of_field, strict=False):
        inner = [(path[0][1] if path else slice(None), path[1:], out) for path, out in some]
        if field.type in TEXTS:
            for _ in range(_count(cursor, field, 4)):
                if field.type == "wstring":
                    raise MessageError("has a wide string before the fields that are wanted")
                cursor.skip(1, cursor.count(1))
        elif field.type in PRIMITIVES:
            letter, size = PRIMITIVES[field.type]
            count = _count(cursor, field, size)
            if not inner:
                cursor.skip(size, count)
                continue
            numbers = cursor.numbers(letter, size, count)
            for chosen, _, out in inner:
                out.extend(map(float, numbers[chosen]))
        else:
            count = _count(cursor, field, plan.least[field.type])
            if plan.least[field.type]:  # types that take no bytes are not stored
                for i in range(count):
                    here = [(path, out) for chosen, path, out in inner if i in range(*chosen.indices(count))]
                    _walk(plan, cursor, field.type, here)


def _count(cursor: Cursor, field: Field, least: int) -> int:
    """Number of values of a field, checked against the bytes that are left."""
    if field.length == SEQUENCE:
        return cursor.count(least)
    count = 1 if field.length is None else field.length
    if count * least > len(cursor.data) - cursor.position:
        raise struct.error(f"{count} of {field.type} in {len(cursor.data)} bytes")
    return count


def types_of(message_type: str, encoding: str, definition: Definition) -> Types | None:
    """The types that make up a message; None if no definition is known."""
    ros1 = encoding == "ros1"
    if definition.text.strip():
        return parse(definition, message_type, ros1)
    if message_type in COMMON:
        others = [f"MSG: {name}\n{text}" for name, text in COMMON.items() if name != message_type]
        return parse(Definition(text=_RULE.join([COMMON[message_type], *others])), message_type, ros1)
    return None if ros1 else _by_rosbags(message_type)


def _by_rosbags(message_type: str) -> Types | None:
    """The types of a ROS 2 message as defined in the package rosbags; None without the package, or the type."""
    try:
        typesys: Any = importlib.import_module("rosbags.typesys")
    except ImportError:
        return None
    package, _, name = message_type.rpartition("/")
    for store in STORES:
        known = typesys.get_typestore(typesys.Stores[store])
        full = f"{package}/msg/{name}"
        if full in known.types:
            text, _ = known.generate_msgdef(full, ros_version=2)
            return parse(Definition(text=text), message_type, ros1=False)
    return None
