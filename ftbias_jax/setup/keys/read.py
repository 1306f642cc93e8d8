"""Values of a setup, each read and checked as the table of keys says."""

from __future__ import annotations

from typing import Any

from ftbias_jax.setup.fields import Section, check_keys, flag, names, require, rows, scalar, subsection, text, vector
from ftbias_jax.setup.keys.key import SEVERAL, Kind
from ftbias_jax.setup.keys.table import section_keys


def open_section(parent: Section, key: str, *, required: bool = False) -> Section:
    """The table at a key, all of whose keys are known; an absent one that is not required is empty."""
    known = section_keys(parent.path(key))
    return subsection(parent, key, known.keys, required=required or known.required)


def check_section(section: Section) -> Section:
    """The section itself, if all its keys are known."""
    return check_keys(section, section_keys(section.name).keys)


def read(section: Section, key: str, size: int | None = None, default: Any = None) -> Any:
    """The value at a key: an array, a number, text, True or False, or a tuple of names.

    Args:
        section: where it stands.
        key: one of the table's.
        size: how many numbers or names, where the table leaves it to the robot.
        default: what holds if the key is absent, where the table leaves it to other keys.

    Returns:
        None, if the key is absent and has no default.

    Raises:
        SetupError: the value has the wrong type, shape or range, or is absent and required.
    """
    known = section_keys(section.name).keys[key]
    default = known.default if default is None else default
    if key not in section.values and default is None and not known.required:
        return None
    count = known.size if size is None else size
    if count == SEVERAL:
        value = section.values.get(key)
        count = max(len(value), 1) if isinstance(value, list) else 1
    match known.kind:
        case Kind.NUMBER:
            return scalar(section, key, default, within=known.within)
        case Kind.NUMBERS:
            return vector(section, key, count, default, within=known.within, expand=known.expand)
        case Kind.TEXT:
            required = default is None
            value = require(section, key, "give a text") if required else default
            return text(section, key, value, known.choices)
        case Kind.FLAG:
            return flag(section, key, default)
        case Kind.NAMES:
            return names(section, key, count)
        case Kind.ROWS:
            return rows(section, key, count)
    raise TypeError(f"{section.path(key)} is {known.kind.value}, which has no single value")
