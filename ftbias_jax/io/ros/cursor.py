"""The bytes of a message, value by value.

ROS 1 stores numbers one after the other; ROS 2 (CDR, OMG DDSI-RTPS 2.3, section 10) starts with four bytes that name
the encoding, aligns every number to its own size, and ends strings with a zero byte.
"""

from __future__ import annotations

import struct

_CDR_ORDERS = {b"\x00\x00": ">", b"\x00\x01": "<"}


class MessageError(Exception):
    """The bytes are not the message they should be; the message is a clause for ours."""


class Cursor:
    """A place in the bytes of a message that moves on with every value read."""

    def __init__(self, data: bytes, encoding: str) -> None:
        self.data, self.cdr = data, encoding == "cdr"
        if not self.cdr and encoding != "ros1":
            raise MessageError(f"has the unknown encoding {encoding[:40]!r}")
        order = _CDR_ORDERS.get(data[:2]) if self.cdr else "<"
        if order is None:
            raise MessageError(f"has the unknown CDR encapsulation {data[:4]!r}")
        self.order, self.origin = order, 4 if self.cdr else 0
        self.position = self.origin

    def header(self) -> tuple[int, str]:
        """Stamp in ns and frame of a std_msgs/Header."""
        if not self.cdr:
            self.uint32()  # the sequence number, which ROS 2 dropped
        seconds, nanoseconds = self.uint32(), self.uint32()
        return seconds * 10**9 + nanoseconds, self.text()

    def uint32(self) -> int:
        """One number."""
        self.align(4)
        (value,) = struct.unpack_from(self.order + "I", self.data, self.position)
        self.position += 4
        return int(value)

    def text(self) -> str:
        """A string of UTF-8."""
        length = self.count(1)
        start, self.position = self.position, self.position + length
        return self.data[start : self.position].removesuffix(b"\x00").decode()

    def floats(self, names: int) -> tuple[float, ...]:
        """float64[] with its length before it: one for each name, or none."""
        count = self.count(8)
        if count not in (0, names):
            raise MessageError(f"has {names} names, but {count} numbers")
        return self.array(count) if count else ()

    def array(self, count: int) -> tuple[float, ...]:
        """float64[count]."""
        self.align(8)
        start, self.position = self.position, self.position + 8 * count
        return struct.unpack_from(f"{self.order}{count}d", self.data, start)

    def numbers(self, letter: str, size: int, count: int) -> tuple[float, ...]:
        """Numbers of one kind."""
        if not count:
            return ()
        self.skip(size, count)
        return struct.unpack_from(f"{self.order}{count}{letter}", self.data, self.position - size * count)

    def skip(self, size: int, count: int) -> None:
        """Move on over numbers; struct.error if they are not there."""
        if count:
            self.align(size)
            self.position += size * count
            if self.position > len(self.data):
                raise struct.error(f"{count} numbers in {len(self.data)} bytes")

    def count(self, size: int, most: int = 2**32) -> int:
        """The length of a list, checked against the bytes that are left before anything is made of that length."""
        count = self.uint32()
        if count > most:
            raise MessageError(f"has a list of {count}, more than {most}")
        if count * size > len(self.data) - self.position:
            raise struct.error(f"a list of {count} in {len(self.data)} bytes")
        return count

    def align(self, size: int) -> None:
        """Move on to where a number of this size may start."""
        if self.cdr:
            self.position += -(self.position - self.origin) % size
