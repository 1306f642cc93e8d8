"""Recognition of a table's columns by their names, from one list of the names that people, robots and loggers use.

Names are compared without case, brackets and units: ``/ft/wrench/force/x``, ``Force X [N]`` and ``force_x`` are the
same name, the first with a prefix. Every reader of tables uses this module, so that all interpret names alike.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from ftbias_jax.io.tables.column_names import (
    BY_JOINT,
    COUNTED,
    DIMENSIONS,
    DIMENSIONS_OF_SEVERAL,
    FIXED,
    IN_BASE_AXES,
    OF_JOINTS,
    OTHER,
    UNITS,
    Names,
)

HALVES = re.compile(r"(|.*_|.*timestamp)(?:(secs?|seconds)|nsecs?|nanosecs?|nanoseconds)")
"""Names of columns that form stamps in pairs, as in ROS messages: whole s, and remaining ns."""
COMMANDED = re.compile(r"(^|_)(target|desired|commanded|command|cmd|setpoint|reference|goal|action)_")
"""Prefixes of commanded quantities, which are not measurements."""
BARE = re.compile(r"(.*_)?states?_|")
"""Prefixes that may precede a name that is only that of a joint."""
_BRACKETS = re.compile(r"\s*[\[(]\s*([^\[\]()]*?)\s*[\])]\s*$")


class Match(NamedTuple):
    """Columns that together form one quantity."""

    names: Names
    """Names as in the header, in order."""
    facts: Mapping[str, str] = {}
    """Keys of a setup and their values that follow from the names: units and axes."""
    joints: Names = ()
    """Names of the joints, if the columns' names contain them."""
    native: bool = False
    """Whether the names match exactly, without prefix or unit; such a match takes precedence over all others."""


class _Column(NamedTuple):
    name: str
    """Name as in the header."""
    plain: str
    """Name in lower case, words separated by underscores, without a unit."""
    unit: str
    """Unit in lower case; "" = none."""


def matches(quantity: str, header: Sequence[str], joints: Sequence[str] | None = None) -> list[Match]:
    """All sets of columns that may form a quantity, excluding commanded ones.

    The number of joint names determines the number of columns of joints; None = any number.
    """
    columns = [column for name in header for column in _forms(name, _words_for(quantity))]
    found = [*_fixed(quantity, columns), *_counted(quantity, columns, joints), *_by_joint(quantity, columns, joints)]
    if not found:
        found = [*_fixed(OTHER + quantity, columns), *_counted(OTHER + quantity, columns, joints)]
    if not found and joints is not None:
        found = list(_numbered_joints(quantity, columns, len(joints)))
    unique: dict[Names, Match] = {}
    for match in found:
        unique.setdefault(match.names, match)
    return list(unique.values())


def are_counted(header: Sequence[str]) -> bool:
    """Whether the columns have numbers instead of names."""
    return bool(header) and list(header) == [str(i + 1) for i in range(len(header))]


def halves_of_stamps(header: Sequence[str]) -> Names:
    """The columns of whole s and remaining ns that form the stamps; () if there are none, several, or other stamps."""
    found: dict[str, dict[bool, str]] = {}
    for name in header:
        if half := HALVES.fullmatch(_plain(name)):
            found.setdefault(half[1], {})[not half[2]] = name
    pairs = [(both[False], both[True]) for both in found.values() if len(both) == 2]
    rest = [name for name in header if name not in sum(pairs, ())]
    return pairs[0] if len(pairs) == 1 and not matches("time", rest) else ()


def some(quantity: str, header: Sequence[str], joints: Sequence[str]) -> bool:
    """Whether any column has a usual name of a quantity, even if the set of its columns is incomplete."""
    tails = {tail for tails in FIXED.get(quantity, ()) for tail in tails}
    tails |= {template.format(_plain(joint)) for template in BY_JOINT.get(quantity, ()) for joint in joints}
    stems = "|".join(COUNTED.get(quantity, ()))
    plain = [column.plain for name in header for column in _forms(name, _words_for(quantity))]
    return any(name in tails or (stems and re.fullmatch(rf"({stems})_?\d+", name)) for name in plain)


def _words_for(quantity: str) -> Mapping[str, str]:
    """Words for units that columns of a quantity may have -> their dimension."""
    dimensions = DIMENSIONS_OF_SEVERAL.get(quantity.removeprefix(OTHER), (DIMENSIONS.get(quantity, ""),))
    return {word: name for name in dimensions if name for word in UNITS[name][1]}


def _forms(name: str, words: Mapping[str, str]) -> Iterator[_Column]:
    """Yield a name without its unit; a name that may end in a unit, such as time_s, both with and without it."""
    bracket = _BRACKETS.search(name)
    unit = bracket[1].lower() if bracket else ""
    for written in (unit, f"[{unit}]"):  # m is the end of too many names to be a unit without brackets
        if bracket and written in words:
            yield _Column(name, _plain(name[: bracket.start()]), written)
            return
    plain = _plain(name)
    yield _Column(name, plain, "")
    stem, _, last = plain.rpartition("_")
    if stem and last in words:
        yield _Column(name, stem, last)


def _plain(name: str) -> str:
    return re.sub(r"[^0-9a-z\u00b0-\uffff]+", "_", name.lower()).strip("_")


def _fixed(quantity: str, columns: Sequence[_Column]) -> Iterator[Match]:
    for tails in FIXED.get(quantity, ()):
        alone = min(map(len, tails)) == 1 or quantity.endswith("time")  # x, or t, is a suffix of too many names
        for start, found in _sharing_a_start(columns, tails):
            if not (alone and start):
                yield from _match(quantity, found, start)


def _counted(quantity: str, columns: Sequence[_Column], joints: Sequence[str] | None) -> Iterator[Match]:
    width = 6 if quantity == "wrench" else None if joints is None else len(joints)
    for stem in COUNTED.get(quantity, ()):
        groups: dict[str, dict[int, _Column]] = {}
        for column in columns:
            if named := re.fullmatch(rf"((?:.*_)?){stem}_?(\d{{1,3}})", column.plain):
                groups.setdefault(named[1], {}).setdefault(int(named[2]), column)
        for start, group in groups.items():
            if (
                _is_counted(group)
                and not (start and stem in OF_JOINTS)
                and (len(group) == width if width else len(group) > 1)
            ):
                axes = {"log.wrench_axes": "base"} if stem in IN_BASE_AXES else {}
                yield from _match(quantity, [group[i] for i in sorted(group)], start, axes)


def _is_counted(group: Mapping[int, _Column]) -> bool:
    """Whether the numbers of columns are counted from 0 or 1 without a gap."""
    return sorted(group) in (list(range(len(group))), list(range(1, len(group) + 1)))


def _by_joint(quantity: str, columns: Sequence[_Column], joints: Sequence[str] | None) -> Iterator[Match]:
    for template in BY_JOINT.get(quantity, ()):
        if joints is not None:
            tails = tuple(template.format(_plain(joint)) for joint in joints)
            for start, found in _sharing_a_start(columns, tails):
                if template != "{}" or BARE.fullmatch(start):
                    yield from _match(quantity, found, start, joints=tuple(joints))
        elif template != "{}":
            yield from _named_after_joints(quantity, columns, *template.split("{}"))


def _match(
    quantity: str, columns: Sequence[_Column], start: str, facts: Mapping[str, str] | None = None, joints: Names = ()
) -> Iterator[Match]:
    """Yield the match of these columns, unless they are commanded or their units contradict each other."""
    units: dict[str, set[str]] = {}
    for i, column in enumerate(columns):
        if column.unit:
            dimension = DIMENSIONS.get(quantity.removeprefix(OTHER), "force" if i < 3 else "torque")
            if dimension == "angle" and column.unit in UNITS["travel"][1]:
                dimension = "travel"
            key, words = UNITS[dimension]
            units.setdefault(key, set()).add(words.get(column.unit, ""))
    if COMMANDED.search(start) or any(len(values) > 1 for values in units.values()):
        return
    stated = {key: next(iter(values)) for key, values in units.items() if key}
    native = not start and not stated and all(column.name == column.plain for column in columns)
    yield Match(tuple(column.name for column in columns), {**stated, **(facts or {})}, joints, native)


def _named_after_joints(quantity: str, columns: Sequence[_Column], before: str, after: str) -> Iterator[Match]:
    """Yield columns of joints of unknown names: the last part of a path without the word for the quantity."""
    groups: dict[str, list[tuple[str, _Column]]] = {}
    for column in columns:
        folder = "/".join(column.name.split("/")[: -2 if after else -1])
        inner = column.plain.removeprefix(_plain(folder)).strip("_")
        joint = inner[len(before) : len(inner) - len(after)]
        if inner.startswith(before) and inner.endswith(after) and len(joint) > 1 and not joint.isdecimal():
            groups.setdefault(folder, []).append((joint, column))
    for folder, group in groups.items():
        if len(group) > 1:
            start = f"{_plain(folder)}_" if folder else ""
            yield from _match(quantity, [column for _, column in group], start, joints=tuple(name for name, _ in group))


def _numbered_joints(quantity: str, columns: Sequence[_Column], count: int) -> Iterator[Match]:
    """Yield columns of numbered joints that have other names in the setup, such as ``actuator_1/position``."""
    for before, after in (template.split("{}") for template in BY_JOINT.get(quantity, ()) if template != "{}"):
        groups: dict[str, dict[int, _Column]] = {}
        for column in columns:
            if named := re.fullmatch(rf"((?:.*_)?{before}[a-z]+)_?(\d{{1,3}}){after}", column.plain):
                groups.setdefault(named[1], {}).setdefault(int(named[2]), column)
        for start, group in groups.items():
            if len(group) == count and _is_counted(group):
                yield from _match(quantity, [group[i] for i in sorted(group)], start)


def _sharing_a_start(columns: Sequence[_Column], tails: Names) -> Iterator[tuple[str, list[_Column]]]:
    """Yield their common prefix and the columns that end in all of the tails, the shortest prefix first."""
    groups: dict[str, dict[str, _Column]] = {}
    for column in columns:
        for tail in tails:
            if column.plain == tail or column.plain.endswith(f"_{tail}"):
                groups.setdefault(column.plain.removesuffix(tail), {}).setdefault(tail, column)
    for start in sorted(groups, key=len):
        if len(groups[start]) == len(set(tails)):
            yield start, [groups[start][tail] for tail in tails]
