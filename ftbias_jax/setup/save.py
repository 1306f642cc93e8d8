"""Writing a setup to a file: the text it was read from is edited, so that only lines of changed values are new."""

import os
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping, MutableMapping, Sequence
from itertools import takewhile
from typing import Any, BinaryIO

import tomlkit
from tomlkit.items import Item, Table

from ftbias_jax.errors import OutputError, SetupError
from ftbias_jax.files import replace_whole
from ftbias_jax.setup.dump import MEASURE, Line, dump_setup, lines_of, same_screws, toml_comment, toml_line, toml_value
from ftbias_jax.setup.parse import parse_setup
from ftbias_jax.setup.types import RobotSetup, Setup

OURS = ("\u00b1", "ftbias ", "tuned, ")
"""Markers of a remark by an earlier command, which a new one replaces; remarks by others stay."""
WRITTEN_BY = "# Written by ftbias "
"""Start of the first line of a setup that a command wrote, and may therefore replace."""
SCREW_SECTIONS = ("[robot.flange]", "[[robot.joints]]")
TERMS = "[[effects.term]]"
"""A section that may occur several times, and is written as a whole."""
_Said = dict[tuple[str, str], Line]


def save_setup(setup: Setup, path: str | os.PathLike[str], by: str = "") -> None:
    """Write a setup as TOML that ``load_setup`` reads back, whole or not at all; ``Setup.save`` is this function.

    If the setup was read from a file, the text of that file is kept except for the lines of changed values.

    Args:
        setup: the setup to write.
        path: the file to make or replace; a link is refused.
        by: the command that writes it, for the first line; "" = a user's own file, which has no such line.

    Raises:
        OutputError: the file cannot be written there.
        SetupError: it has values that no setup may have.
    """
    text = re.sub(rf"\A{WRITTEN_BY}.*\n", "", edited_text(setup, os.fspath(path)))
    try:
        parse_setup(tomllib.loads(text), os.fspath(path))  # every command must be able to read it
    except SetupError as error:
        remedy = "state values that a body can have, or record a motion that determines them"
        message = f"nothing is written, because no command could read it: {error.message}"
        raise SetupError(message, file=os.fspath(path), field=error.field, remedy=remedy) from error
    write_text(path, f"{WRITTEN_BY}{by}, which may replace it\n{text}" if by else text)


def write_atomic(path: str | os.PathLike[str], write: Callable[[BinaryIO], object]) -> None:
    """Write a file through a temporary one beside it: written, flushed to disk, then renamed.

    On any failure the temporary file is removed, and the former content of ``path`` is kept.

    Args:
        path: the file to make or replace.
        write: called once with the open temporary file. Its exceptions, except OSError, are passed on.

    Raises:
        OutputError: the file cannot be written there, or it is a symbolic link.
    """
    name = os.fspath(path)
    refuse_link(name)
    if os.path.exists(name) and not os.path.isfile(name):
        raise OutputError("cannot be written: it is not a regular file", file=name, remedy="give the path of a file")
    try:
        replace_whole(os.path.abspath(name), write)
    except OSError as error:
        remedy = "check that the folder exists, may be written to and has room"
        raise OutputError(f"cannot be written: {error.strerror or error}", file=name, remedy=remedy) from error


def refuse_link(path: str | os.PathLike[str]) -> None:
    """Raise an error if an output is a symbolic link, because its target was not named and may be a recording."""
    if os.path.islink(path):
        raise OutputError("is a symbolic link", file=path, remedy="remove it, or name the file that it leads to")


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a text file whole or not at all; see ``write_atomic``."""
    write_atomic(path, lambda file: file.write(text.encode()))


def edited_text(setup: Setup, target: str = "") -> str:
    """Return the text of a setup for the file ``target``, whose folder a relative path of a URDF or an MJCF refers to.

    It is the text that the setup was read from with the changed values, new keys at the end of their sections, and
    ``setup.comments`` on the changed lines. The setup is written anew if it was not read from a text, or if a list of
    screws changed.
    """
    if not setup.source:
        return dump_setup(setup)
    read = parse_setup(tomllib.loads(setup.source), setup.path)
    if not _same_arm(read.robot, setup.robot):
        return dump_setup(setup)
    text = _edited(setup, _said(read), _said(setup), target)
    if toml_value(_terms(read)) != toml_value(_terms(setup)):
        text = _with_terms(text, _terms(setup))
    try:
        written = parse_setup(tomllib.loads(text), target)
    except (SetupError, tomllib.TOMLDecodeError):  # unusual TOML that was not edited correctly
        return dump_setup(setup)
    return text if _values(written) == _values(setup) and _same_arm(written.robot, setup.robot) else dump_setup(setup)


def _edited(setup: Setup, before: _Said, after: _Said, target: str) -> str:
    document = tomlkit.parse(setup.source)
    _move_description(document, setup, target)
    stated = {place: toml_value(line.value) for place, line in before.items()}
    changed = [place for place, line in after.items() if stated.get(place) != toml_value(line.value)]
    tool = document.get("tool", {})
    if "from_urdf_link" in tool and any(section == "[tool]" for section, _ in changed):
        del tool["from_urdf_link"]
        changed += [place for place in after if place[0] == "[tool]" and place not in changed]
    for section, key in before.keys() - after.keys():
        if not key:
            del document["effects"][section.strip("[]").partition(".")[2].strip('"')]
            continue
        table = _table(document, section)
        if table is not None and key in table:
            del table[key]
    new: dict[str, list[str]] = {}
    for place in changed:
        line = after[place]
        remark = setup.comments.get(line.full_key, "")
        table = _table(document, line.section)
        if table is None:
            text = toml_line(line.key, line.value, line.comment(remark)) if line.key else ""
            new.setdefault(line.section, []).append(text)
        elif line.key:
            _put(table, line, remark)
    written = tomlkit.dumps(document)
    for _, key in after.keys() - before.keys():  # the template's reminder of a key that is now stated
        written = re.sub(rf"^# {re.escape(key)} = .*{MEASURE}\n", "", written, count=1, flags=re.MULTILINE)
    for section, lines in new.items():
        written = f"{written.rstrip()}\n\n{section}\n" + "".join(f"{text}\n" for text in lines if text)
    return written


def _with_terms(text: str, terms: Iterable[Mapping[str, Any]]) -> str:
    """Replace the terms of a text by these, at its end."""
    document = tomlkit.parse(text)
    document.get("effects", {}).pop("term", None)
    lines = ("".join(f"{toml_line(key, value)}\n" for key, value in term.items()) for term in terms)
    return f"{tomlkit.dumps(document).rstrip()}\n" + "".join(f"\n{TERMS}\n{some}" for some in lines)


def _terms(setup: Setup) -> Sequence[Mapping[str, Any]]:
    terms = setup.effects.get("term", ())
    return terms if isinstance(terms, list | tuple) else ()  # else an effect of that name, which does not exist


def _put(table: MutableMapping[str, Any], line: Line, remark: str) -> None:
    """Set one value; the comment behind the old one stays."""
    item: Item = tomlkit.parse(f"x = {toml_value(line.value)}\n")["x"]
    old = table.get(line.key)
    if isinstance(old, Item):
        for name in ("indent", "comment_ws", "comment", "trail"):
            setattr(item.trivia, name, getattr(old.trivia, name))
        if remark:
            parts = old.trivia.comment.lstrip("# ").split("; ")  # without the remarks of earlier commands
            theirs = takewhile(lambda part: not any(mark in part for mark in OURS), parts)
            _comment(item, "; ".join(theirs), remark, line)
    if isinstance(old, Item) or not isinstance(table, Table):  # the latter: an inline table, which has no comments
        table[line.key] = item
        return
    _comment(item, "", remark, line)
    body = table.value.body
    tail = []
    while body and body[-1][0] is None:  # blank lines and comments that belong to the next section
        tail.append(body.pop())
    table.add(line.key, item)
    body.extend(reversed(tail))


def _comment(item: Item, old: str, remark: str, line: Line) -> None:
    if comment := toml_comment(f"{old}; {remark}" if old else line.comment(remark)):
        item.trivia.comment_ws, item.trivia.comment = "  ", comment.strip()


def _move_description(document: MutableMapping[str, Any], setup: Setup, target: str) -> None:
    """Adapt a relative path of a URDF or an MJCF, which refers to the setup's folder, to the target's folder."""
    robot = document.get("robot", {})
    folders = [os.path.realpath(os.path.dirname(path) or ".") for path in (setup.path, target)]
    for key in ("urdf", "mjcf") if target and folders[0] != folders[1] else ():
        if key in robot and not os.path.isabs(robot[key]):
            moved = os.path.relpath(os.path.join(folders[0], robot[key]), folders[1])
            _put(robot, Line("[robot]", key, moved), "")


def _said(setup: Setup) -> _Said:
    """The lines of a setup by section and key, without the list of screws and the terms."""
    apart = (*SCREW_SECTIONS, TERMS)
    return {(line.section, line.key): line for line in lines_of(setup) if line.section not in apart}


def _same_arm(one: RobotSetup, two: RobotSetup) -> bool:
    return same_screws(one, two) and (one.joint_names, one.model) == (two.joint_names, two.model)


def _values(setup: Setup) -> tuple[str, dict[tuple[str, str], str]]:
    return toml_value(_terms(setup)), {place: toml_value(line.value) for place, line in _said(setup).items()}


def _table(document: MutableMapping[str, Any], section: str) -> MutableMapping[str, Any] | None:
    """The table of a section such as ``[effects.drag]``, if the text has it."""
    table: Any = document
    names: Any = tomllib.loads(section)
    while names:
        (name,) = names
        if not isinstance(table, MutableMapping) or name not in table:
            return None
        table, names = table[name], names[name]
    return table if isinstance(table, MutableMapping) else None
