"""Structs of Thrift's compact protocol."""

import pytest

from ftbias_jax.io.limits.thrift import struct_at


def test_a_struct_of_all_that_a_footer_has():
    data = (
        b"\x15\x02"  # field 1: 1
        b"\x18\x03abc"  # field 2: text
        b"\x11"  # field 3: true
        b"\x29\x35\x01\x04\x06"  # field 5: [-1, 2, 3]
        b"\x1c\x16\x08\x00"  # field 6: a struct {1: 4}
        b"\x17" + bytes(8) + b"\x13\x07"  # fields 7 and 8: a double and a byte
        b"\x05\x28\x15"  # field 20, its number written out: -11
        b"\x00rest"
    )
    fields, end = struct_at(data)
    assert fields == {1: 1, 2: b"abc", 5: [-1, 2, 3], 6: {1: 4}, 7: None, 8: None, 20: -11}
    assert data[end:] == b"rest"


@pytest.mark.parametrize(
    "data", [b"", b"\x15", b"\x15\xff", b"\x18\x09abc", b"\x19\xf5\xff\xff\x03", b"\x1c" * 100, b"\x1b\x00", b"\x1e"]
)
def test_what_is_none_is_refused(data):
    with pytest.raises((ValueError, IndexError)):
        struct_at(data)
