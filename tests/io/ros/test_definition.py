"""Message definitions in both languages, intact and hostile."""

import time
from contextlib import suppress

import pytest

from ftbias_jax.io.ros.definition import MAX_TEXT, Field, parse_idl, parse_msg, smallest
from ftbias_jax.io.ros.messages import MessageError

RULE = "\n" + "=" * 80 + "\n"
IDL = """IDL: my_msgs/msg/State
// generated
#include "std_msgs/msg/Header.idl"
module my_msgs {
  module msg {
    typedef double double__7[7];
    typedef std_msgs::msg::Header Header__2[2];
    module State_Constants {
      @verbatim (language="comment", text="the mode" " (idle; or not)")
      const uint8 MODE_IDLE = 1;
      const string NAME = "a; b";
    };
    @verbatim (language="comment", text=
      "what an arm says")
    struct State {
      std_msgs::msg::Header header;
      @unit (value="rad")
      double__7 q;
      sequence<double> load;
      sequence<my_msgs::msg::Inner, 5> more;
      @default (value=1.5)
      float gain;
      boolean on, off;
      string<20> label;
      unsigned long long big;
      octet grid[2][3];
    };
  };
};
""" + "=" * 80 + """
IDL: my_msgs/msg/Inner
module my_msgs { module msg { struct Inner { uint8 structure_needs_at_least_one_member; }; }; };
"""  # fmt: skip


def test_the_two_languages_say_the_same():
    msg = (
        "std_msgs/Header header\nfloat64[7] q\nfloat64[] load\nInner[<=5] more\nfloat32 gain 1.5\nbool on\nbool off\n"
        f"string<=20 label\nuint64 big\nbyte[6] grid{RULE}MSG: my_msgs/msg/Inner\n"
    )
    ours, theirs = parse_msg(msg, "my_msgs/State", False), parse_idl(IDL, "my_msgs/State")
    changed = [Field(name, {"byte": "octet"}.get(kind, kind), length) for name, kind, length in ours["my_msgs/State"]]
    assert theirs["my_msgs/State"] == tuple(changed)
    assert theirs["my_msgs/Inner"] == ours["my_msgs/Inner"] == (Field("_", "uint8"),)


def test_names_without_a_package_are_of_the_package_they_stand_in():
    text = f"Header header\nB b\ntime at\nother/msg/C c\nfloat64[4] x{RULE}MSG: other/C\nB b{RULE}MSG: other/B\nint8 x"
    types = parse_msg(text, "mine/A", True)
    kinds = [field.type for field in types["mine/A"]]
    assert kinds == ["std_msgs/Header", "mine/B", "builtin_interfaces/Time", "other/C", "float64"]
    assert types["other/C"] == (Field("b", "other/B"),)
    assert [field.name for field in types["std_msgs/Header"]] == ["seq", "stamp", "frame_id"]


def test_the_least_bytes_of_a_type():
    text = f"B[3] b\nB[] more\nstring name\nfloat64 x{RULE}MSG: a/B\nint16 x\nuint8[5] y"
    assert smallest(parse_msg(text, "a/A", True), "a/A")["a/A"] == 3 * 7 + 4 + 4 + 8


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("A a", "types nested too deeply"),
        (f"B b{RULE}MSG: a/B\nA a", "types nested too deeply"),
        (RULE.join(["T1 t", *(f"MSG: a/T{i}\nT{i + 1} t" for i in range(1, 60))]), "types nested too deeply"),
        ("Other x", "lacks the type 'a/Other'"),
        ("???", r"with the line '\?\?\?'"),
        (f"float64 x{RULE}no title", "a type has no name"),
        ("x" * (MAX_TEXT + 1), "a definition of 262145 characters"),
    ],
)
def test_definitions_that_make_no_sense(text, words):
    with pytest.raises(MessageError, match=words):
        smallest(parse_msg(text, "a/A", True), "a/A")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("module a { struct A { double x;", "ends too early"),
        ("module a {" * 20, "modules within modules without end"),
        ("module a { struct A { sequence<sequence<double>> x; }; };", "lists of lists"),
        ("module a { typedef sequence<double> L; struct A { L x[2]; }; };", "lists of lists"),
        ("module a { struct A { double x[1e9]; }; };", "an array of '1e9'"),
        ("module a { struct A { double x[9999999999]; }; };", "an array of '9999999999'"),
        ('module a { const string X = "no end', "a text that does not end"),
        ("module a [", r"with '\[' where '{' should be"),
    ],
)
def test_idl_that_makes_no_sense(text, words):
    with pytest.raises(MessageError, match=words):
        parse_idl(text, "a/A")


@pytest.mark.parametrize(
    "text",
    [
        "/*" * 400_000,
        '"\\' * 400_000,
        "@a " * 300_000,
        "@a(" * 300_000,
        "module a { struct A { sequence<" + "sequence<" * 100_000,
        "module a { struct A {" + " double x;" * 90_000,
        "a" * 1_000_000,
        "=" * 1_000_000 + "x",
        " " * 1_000_000 + "x",
        "a " * 500_000,
    ],
)
def test_hostile_definitions_take_no_more_time_than_they_are_long(text):
    start = time.process_time()
    for parse in (parse_idl, lambda text, name: parse_msg(text, name, True)):
        with suppress(MessageError):
            parse(text[:MAX_TEXT], "a/A")
    assert time.process_time() - start < 5
