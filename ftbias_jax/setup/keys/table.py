"""Every key of a setup, section by section, as stated in keys.toml, and the reading of values by this table.

As a JSON Schema the table lets editors complete and check a setup while it is written.
"""

import re
import tomllib
from collections.abc import Collection, Mapping
from enum import Enum
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.setup import fields, recorded
from ftbias_jax.setup.fields import Section
from ftbias_jax.setup.robots import BUILT_IN, CONVENTIONS, FIXED, UNITS
from ftbias_jax.setup.types import COMPENSATED, JOINT_MODELS, REPORTS


class Kind(Enum):
    """Kind of value that a key has."""

    NUMBER = "number"
    NUMBERS = "numbers"
    TEXT = "text"
    FLAG = "flag"
    NAMES = "names"
    ROWS = "rows"
    TABLE = "table"
    TABLES = "tables"


PER_JOINT = 0
"""Size of a key that has an entry for every joint, or for every entry of a recorded pose."""
SEVERAL = -1
"""Size of a key that has as many numbers as there are events."""


class Key(NamedTuple):
    """One key of a section; keys.toml documents the fields."""

    kind: Kind
    meaning: str
    unit: str = ""
    size: int = 1
    """Count of numbers or names, or PER_JOINT, or SEVERAL."""
    expand: bool = False
    above: float = -np.inf
    least: float = -np.inf
    default: Any = None
    """Value if the key is absent; None = no default."""
    required: bool = False
    quiet: bool = False
    choices: tuple[str, ...] = ()
    absent: str = ""
    example: Any = None

    @property
    def has_value(self) -> bool:
        """Whether the key has a value, rather than a table."""
        return self.kind not in (Kind.TABLE, Kind.TABLES)


class SectionKeys(NamedTuple):
    """Description and keys of one section."""

    about: str
    keys: Mapping[str, Key]
    required: bool = False
    further: str = ""
    """Meaning of any other key, whose value is text; "" = no other key is allowed."""


_CHOICES = {
    "robot.model": BUILT_IN,
    "robot.dh": ("revolute", FIXED),
    "robot.dh_convention": CONVENTIONS,
    "robot.dh_units": UNITS,
    "robot.joints.type": ("revolute", "prismatic"),
    "sensor.reports": REPORTS,
    "sensor.compensated": COMPENSATED,
    "sensor_pose.orientation": recorded.ORIENTATIONS,
    "sensor_pose.linear": recorded.LINEAR,
    "sensor_pose.position_axes": recorded.POSITION_AXES,
    "joints.model": JOINT_MODELS,
    "log.time_unit": recorded.TIME_UNITS,
    "log.angle_unit": recorded.ANGLE_UNITS,
    "log.acceleration_unit": recorded.ACCELERATION_UNITS,
    "log.length_unit": recorded.LENGTH_UNITS,
    "log.force_unit": recorded.FORCE_UNITS,
    "log.torque_unit": recorded.TORQUE_UNITS,
    "log.wrench_axes": recorded.WRENCH_AXES,
    "log.clocks": recorded.CLOCKS,
    "log.time_units": recorded.TIME_UNITS,
}
"""Allowed values of a text, or of the entry behind the numbers of a row: by key, or by section for all its keys."""


def _key(name: str, entry: dict[str, Any]) -> Key:
    entry |= entry.pop("is", {})
    (kind,) = (kind for kind in Kind if kind.value in entry)
    meaning = entry.pop(kind.value)
    entry["size"] = {"joints": PER_JOINT, "events": SEVERAL}.get(entry.get("size", 1), entry.get("size", 1))
    choices = _CHOICES.get(name, _CHOICES.get(name.rpartition(".")[0], ())) if kind in (Kind.TEXT, Kind.ROWS) else ()
    return Key(kind, meaning, choices=tuple(choices), **{word: _fixed(value) for word, value in entry.items()})


def _fixed(value: Any) -> Any:
    return tuple(map(_fixed, value)) if isinstance(value, list) else value


SECTIONS: Mapping[str, SectionKeys] = {
    name: SectionKeys(**{**stated, "keys": {key: _key(f"{name}.{key}", {**x}) for key, x in stated["keys"].items()}})
    for name, stated in tomllib.loads(Path(__file__).with_name("keys.toml").read_text(encoding="utf-8")).items()
}
"""Full name of a section -> its keys."""
EFFECTS = "effects"
"""The section whose keys are those of the catalogue of effects."""
TOP = (*(name for name in SECTIONS if "." not in name), EFFECTS)
"""Names that are allowed at the top level of a setup."""


def further_columns(columns: Mapping[str, str | tuple[str, ...]]) -> dict[str, str]:
    """Columns of [log.columns] that effects see under a name of the user's choice -> their names in the file."""
    known = SECTIONS["log.columns"].keys
    return {key: name for key, name in columns.items() if key not in known and isinstance(name, str)}


def section_keys(name: str) -> SectionKeys:
    """Keys of the section with a full name such as ``robot.joints[2]``."""
    return SECTIONS[re.sub(r"\[\d+\]", "", name)]


def key_of(full_name: str) -> Key | None:
    """Key with a full name such as ``tool.mass``; None if the table does not have it."""
    section, _, key = full_name.rpartition(".")
    return section_keys(section).keys.get(key) if section in SECTIONS else None


def open_section(parent: Section, key: str, *, required: bool = False) -> Section:
    """Return the table at a key, all of whose keys must be known; an absent optional one is empty."""
    known = section_keys(parent.path(key))
    return fields.subsection(parent, key, known.keys, required=required or known.required)


def read(section: Section, key: str, size: int | None = None, default: Any = None) -> Any:
    """Return the value at a key: an array, a number, text, True or False, or a tuple of names.

    Args:
        section: the section that has the key.
        key: a key of that section.
        size: count of numbers or names, where the table of keys leaves it to the robot.
        default: value if the key is absent, where the table of keys leaves it to other keys.

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
    value = section.values.get(key, default)
    if count == SEVERAL:
        count = max(len(value), 1) if isinstance(value, list) else 1
    match known.kind:
        case Kind.NUMBER if isinstance(value, list):
            raise section.error(key, f"expected one number, got {fields.show(value)}", "write it without brackets")
        case Kind.NUMBER:
            return float(fields.vector(section, key, 1, default, within=(known.least, known.above))[0])
        case Kind.NUMBERS:
            bounds = (known.least, known.above)
            return fields.vector(section, key, count, default, within=bounds, expand=known.expand)
        case Kind.TEXT:
            return fields.text(section, key, default, known.choices)
        case Kind.FLAG if not isinstance(value, bool):
            raise section.error(key, f"expected true or false, got {fields.show(value)}", "write it without quotes")
        case Kind.FLAG:
            return value
        case Kind.NAMES:
            return fields.names(section, key, count)
        case Kind.ROWS:
            return fields.rows(section, key, count)
    raise TypeError(f"{section.path(key)} is a {known.kind.value}, which has no single value")


def read_all(section: Section, apart: Collection[str] = ()) -> dict[str, Any]:
    """Return all values of a section by key, except the keys ``apart``."""
    return {key: read(section, key) for key in section_keys(section.name).keys if key not in apart}


def json_schema() -> dict[str, Any]:
    """JSON Schema of a setup, draft 2020-12.

    It covers types, shapes, ranges and names. Conditions on several keys, such as that a robot is stated in one way
    only, or that a body can have an inertia, are checked by ``parse_setup`` alone.
    """
    top = {name: _section_schema(name) for name in SECTIONS if "." not in name}
    effects = {"type": "object", "additionalProperties": {"type": "object"}}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Setup of ftbias",
        "type": "object",
        "properties": {**top, EFFECTS: effects},
        "required": ["sensor"],
        "anyOf": [{"required": ["robot"]}, {"required": ["sensor_pose"]}],
        "additionalProperties": False,
    }


def _section_schema(name: str) -> dict[str, Any]:
    section = SECTIONS[name]
    return {
        "type": "object",
        "description": section.about,
        "properties": {key: _key_schema(f"{name}.{key}", known) for key, known in section.keys.items()},
        "required": [key for key, known in section.keys.items() if known.required],
        "additionalProperties": {"type": "string", "description": section.further} if section.further else False,
    }


def _key_schema(name: str, key: Key) -> dict[str, Any]:
    words = f"{key.meaning} [{key.unit}]" if key.unit else key.meaning
    described: dict[str, Any] = {"description": words}
    if key.default is not None:
        described["default"] = list(key.default) if isinstance(key.default, tuple) else key.default
    return described | _type(name, key)


def _type(name: str, key: Key) -> dict[str, Any]:
    match key.kind:
        case Kind.NUMBER:
            return _number(key)
        case Kind.NUMBERS:
            several = key.size in (PER_JOINT, SEVERAL)
            lists = [
                _list(_number(key), size) for size in ([key.size] if several else fields.sizes_of(key.size, key.expand))
            ]
            choices = [_number(key), *lists] if key.expand else lists
            return choices[0] if len(choices) == 1 else {"anyOf": choices}
        case Kind.TEXT:
            return {"type": "string", "enum": list(key.choices)} if key.choices else {"type": "string"}
        case Kind.FLAG:
            return {"type": "boolean"}
        case Kind.NAMES:
            return {**_list({"type": "string"}, key.size), "uniqueItems": True}
        case Kind.ROWS:
            row = [{"type": "number"}] * key.size
            ends = {"items": {"enum": list(key.choices)}, "minItems": key.size, "maxItems": key.size + 1}
            return _list({"type": "array", "prefixItems": row, **ends}, SEVERAL)
        case Kind.TABLE:
            return _section_schema(name)
    return {"type": "array", "items": _section_schema(name), "minItems": 1}


def _number(key: Key) -> dict[str, Any]:
    bounds = {"exclusiveMinimum": key.above, "minimum": key.least}
    return {"type": "number", **{word: bound for word, bound in bounds.items() if np.isfinite(bound)}}


def _list(items: dict[str, Any], size: int) -> dict[str, Any]:
    ends = {"minItems": 1} if size in (PER_JOINT, SEVERAL) else {"minItems": size, "maxItems": size}
    return {"type": "array", "items": items, **ends}
