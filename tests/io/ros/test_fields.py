"""Fields of messages by their paths, against messages that the package rosbags writes."""

import struct

import numpy as np
import pytest
import recordings
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ftbias_jax.errors import LogError
from ftbias_jax.io.ros.fields import COMMON, make_plan, take, types_of
from ftbias_jax.io.ros.messages import MessageError
from ftbias_jax.io.ros.raw import Definition

STATE = """# the state of an arm
std_msgs/Header header
uint8 MODE_IDLE=1
uint8 MODE_MOVE = 2
string NAME="a # b"
uint8 mode 3
bool[3] flags
string<=20 label
float32[] load
int16[2] counts
Inner[2] inner
Inner[] more
geometry_msgs/WrenchStamped ft
float64[7] q
float64[<=9] dq
float64 last
"""
INNER = "uint8 small\nstring[] names\nbuiltin_interfaces/Time at\nfloat64 value"
STORES = {"cdr": Stores.ROS2_JAZZY, "ros1": Stores.ROS1_NOETIC}


def text_for(encoding):
    if encoding == "cdr":
        return STATE, INNER
    state = STATE.replace("<=20", "").replace("[<=9]", "[]").replace(" 3\n", "\n")
    return state, INNER.replace("builtin_interfaces/Time", "time")


class Made:
    """A message of my_msgs/State with random numbers, as bytes, and its definition."""

    def __init__(self, encoding, label="abc"):
        store = get_typestore(STORES[encoding])
        state, inner = text_for(encoding)
        store.register(get_types_from_msg(inner, "my_msgs/msg/Inner") | get_types_from_msg(state, "my_msgs/msg/State"))
        rng = np.random.default_rng(0)
        self.fields = {
            "mode": 2,
            "flags": [True, False, True],
            "label": label,
            "load": rng.normal(size=3).astype(np.float32),
            "counts": [-5, 7],
            "q": rng.normal(size=7),
            "dq": rng.normal(size=5),
            "last": 4.5,
        }
        self.wrench, self.inner = rng.normal(size=6), rng.normal(size=2)
        self.more = rng.normal(size=3)
        parts = [
            [{"small": 3, "names": ["a", "bcd"], "at": (5, 6), "value": x} for x in values]
            for values in (self.inner, self.more)
        ]
        wrench = {"force": tuple(self.wrench[:3]), "torque": tuple(self.wrench[3:])}
        nested = dict(zip(("inner", "more"), parts, strict=True)) | {"ft": {"wrench": wrench}}
        header = recordings.header(store, 12 * recordings.SECOND + 34, "base", 1)
        content = recordings.filled(store, "my_msgs/msg/State", self.fields | nested, header)
        serialize = store.serialize_cdr if encoding == "cdr" else store.serialize_ros1
        self.data = bytes(serialize(content, "my_msgs/msg/State"))
        text, _ = store.generate_msgdef("my_msgs/msg/State", ros_version=2 if encoding == "cdr" else 1)
        self.types = types_of("my_msgs/State", encoding, Definition("ros2msg", text))
        self.encoding = encoding

    def take(self, text):
        return take(make_plan(self.types, "my_msgs/State", text), self.data, self.encoding)


@pytest.mark.parametrize("encoding", STORES)
@pytest.mark.parametrize("label", ["", "a", "abcd", "abcdefg"])
def test_fields_of_every_kind(encoding, label):
    made = Made(encoding, label)
    q, flat = made.fields["q"], ("mode", "flags", "load", "counts", "q", "dq", "last")
    expected = {name: np.atleast_1d(made.fields[name]) for name in flat} | {
        "ft.wrench": made.wrench,
        "ft.wrench.torque": made.wrench[3:],
        "ft.wrench.force.y": made.wrench[1:2],
        "q[2]": q[2:3],
        "q[1:4]": q[1:4],
        "q[:2]": q[:2],
        "q[5:]": q[5:],
        "inner.value": made.inner,
        "inner[1].value": made.inner[1:],
        "more[0:2].value": made.more[:2],
        "more.at": [5, 6] * 3,
        "last,q[0], ft.wrench.force.x": [4.5, q[0], made.wrench[0]],
        "header.stamp": [12, 34],
    }
    for path, values in expected.items():
        sampled = made.take(path)
        assert sampled.values == tuple(map(float, values)), path
        assert (sampled.stamp, sampled.names) == (12 * 10**9 + 34, ("base",))


@pytest.mark.parametrize(
    ("path", "message", "remedy"),
    [
        ("wrenches", "my_msgs/State has no field 'wrenches'", "known: "),
        ("ft.wrensh", "geometry_msgs/WrenchStamped has no field 'wrensh'", "did you mean 'wrench'?"),
        ("last.x", "float64 has no field 'x'", "known: "),
        ("last[0]", "'last' of my_msgs/State is no list", "leave the brackets out"),
        ("label", "'label' is text", "name a field of numbers"),
        ("q[]", "'q[]' is no field", "state.tau[0:6]"),
        ("q[-1]", "'q[-1]' is no field", "state.tau[0:6]"),
        ("__class__.x", "'__class__' is no field", "state.tau[0:6]"),
    ],
)
def test_paths_that_are_not_there_say_what_is(path, message, remedy):
    with pytest.raises(LogError) as caught:
        Made("cdr").take(path)
    assert message in caught.value.message
    assert remedy in caught.value.remedy


def test_bytes_that_are_cut_anywhere_are_damage():
    for encoding in STORES:
        made = Made(encoding)
        plan = make_plan(made.types, "my_msgs/State", "last")
        for length in range(4, len(made.data) - 8):
            with pytest.raises(MessageError):
                take(plan, made.data[:length], encoding)


def test_lists_that_declare_more_than_there_is_take_no_memory():
    types = types_of("a/B", "cdr", Definition("ros2msg", "float64[] x\nfloat64 y"))
    with pytest.raises(MessageError, match="a list of 4294967295"):
        take(make_plan(types, "a/B", "x"), b"\0\1\0\0" + b"\xff" * 4 + bytes(20), "cdr")
    many = struct.pack("<I", 2000) + bytes(4 + 8 * 2001)
    with pytest.raises(MessageError, match="2000 numbers in the fields that are wanted"):
        take(make_plan(types, "a/B", "x"), b"\0\1\0\0" + many, "cdr")
    assert len(take(make_plan(types, "a/B", "y"), b"\0\1\0\0" + many, "cdr").values) == 1


def test_what_is_stored_of_nothing_is_not_walked_through():
    """A type of size zero, a billion times a billion of it, and a thousand fields of it."""
    text = "Empty[999999999] x\nEmpty[] many\n" + "Empty y\n" * 1000 + "float64 z\n" + "=" * 80
    text += "\nMSG: a/Empty\nNothing[999999999] x\n" + "=" * 80 + "\nMSG: a/Nothing\n"
    types = types_of("a/B", "ros1", Definition("ros1msg", text))
    data = struct.pack("<Id", 0xFFFFFFFF, 2.5)
    assert take(make_plan(types, "a/B", "z"), data, "ros1").values == (2.5,)


def test_the_definitions_that_are_built_in_are_those_of_ros():
    store = get_typestore(Stores.ROS2_JAZZY)
    for name in COMMON:
        package, kind = name.split("/")
        text, _ = store.generate_msgdef(f"{package}/msg/{kind}", ros_version=2)
        brought = types_of(name, "cdr", Definition("ros2msg", text))
        ours = types_of(name, "cdr", Definition())
        assert {inner: ours[inner] for inner in brought} == dict(brought), name


def test_types_that_nobody_brings_are_asked_of_rosbags():
    types = types_of("nav_msgs/Odometry", "cdr", Definition())
    plan = make_plan(types, "nav_msgs/Odometry", "pose.pose.position")
    assert [name for name, _ in plan.paths[0]] == ["pose", "pose", "position"]
    assert types_of("my_msgs/State", "cdr", Definition()) is None
    assert types_of("nav_msgs/Odometry", "ros1", Definition()) is None
