"""Assignment of stamps to arrays, in files of arrays whose streams have clocks of their own.

It follows their names: stamps are in the folder of an array, or share words with it, as ``time_ft`` does with ``ft``,
and ``timestamps/joint_positions`` with ``robot_state/joint_positions``.
"""

import re
from collections.abc import Iterable, Mapping

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.types import Array

TIME = frozenset(("t", "time", "timestamp", "stamp"))
"""Words of which the name of stamps contains at least one."""
SAME = {
    **dict.fromkeys(("q", "dq", "joint", "robot", "arm", "qpos", "qvel"), "joint"),
    **dict.fromkeys(("wrench", "ft", "force", "torque", "sensor"), "wrench"),
}
"""Word -> the stream that it denotes."""
STREAMS = {"t_joints": ("q", "dq"), "t_wrench": ("wrench", "temperature")}
"""Stamps of a log -> the arrays that they belong to."""


def clocks_of(shapes: Mapping[str, tuple[int, ...]]) -> dict[str, str]:
    """Array -> its stamps, by the names and shapes of all arrays; an array with an ambiguous match is left out."""
    stamps = [name for name, shape in shapes.items() if len(shape) == 1 and _words(name) & TIME]
    found: dict[str, str] = {}
    for name in shapes.keys() - set(stamps):
        likeness = {clock: _likeness(name, clock) for clock in stamps if shapes[clock][:1] == shapes[name][:1]}
        best = max(likeness.values(), default=None)
        likeliest = [clock for clock, value in likeness.items() if value == best]
        if len(likeliest) == 1:
            found[name] = likeliest[0]
    return found


def stamps_by_stream(
    used: Mapping[str, Iterable[str]], clocks: Mapping[str, str], arrays: Mapping[str, Array], file: str
) -> dict[str, Array]:
    """The stamps t_joints and t_wrench of a log, or t if they are equal, from the arrays ``used`` for its parts.

    Raises:
        LogError: the arrays of a stream have different stamps, or none.
    """
    found: dict[str, Array] = {}
    for stream, parts in STREAMS.items():
        for name in (name for part in parts for name in used.get(part, ())):
            if name not in clocks:
                raise LogError("cannot determine which stamps belong to it", file=file, field=name, remedy=_REMEDY)
            t = arrays[clocks[name]]
            if not np.array_equal(np.asarray(found.setdefault(stream, t)), np.asarray(t)):
                message = f"has other stamps, {clocks[name]}, than the other arrays of its stream"
                raise LogError(message, file=file, field=name, remedy=_REMEDY)
    first = next(iter(found.values()))
    return {"t": first} if all(np.array_equal(t, first) for t in found.values()) else found


_REMEDY = "store the stamps of the joints as t_joints, and those of the wrench as t_wrench"


def _likeness(name: str, clock: str) -> tuple[bool, int, int]:
    """Whether stamps are in the folder of an array, and how many words, and synonyms (SAME), they share with it."""
    folder, of_clock = (path.rpartition("/")[0] for path in (name, clock))
    words, meant = ((_words(name, same) & _words(clock, same)) - TIME for same in ({}, SAME))
    return folder == of_clock != "", len(words), len(meant)


def _words(name: str, same: Mapping[str, str] = {}) -> set[str]:
    words = (word.removesuffix("s") for word in re.findall("[a-z]+", name.lower()))
    return {same.get(word, word) for word in words}
