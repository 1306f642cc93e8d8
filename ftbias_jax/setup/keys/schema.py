"""The table of keys as a JSON Schema, with which editors complete and check a setup while it is written."""

from __future__ import annotations

from typing import Any

import numpy as np

from ftbias_jax.setup.fields import sizes_of
from ftbias_jax.setup.keys.table import EFFECTS, PER_JOINT, SECTIONS, SEVERAL, Key, Kind


def json_schema() -> dict[str, Any]:
    """The schema, draft 2020-12.

    It knows types, shapes, ranges and names. What depends on several keys, such as that a robot is stated in one way
    alone, or that an inertia belongs to a body, only ``parse_setup`` checks.
    """
    top = {name: _section(name) for name in SECTIONS if "." not in name}
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


def _section(name: str) -> dict[str, Any]:
    section = SECTIONS[name]
    return {
        "type": "object",
        "description": section.about,
        "properties": {key: _key(f"{name}.{key}", known) for key, known in section.keys.items()},
        "required": [key for key, known in section.keys.items() if known.required],
        "additionalProperties": {"type": "string", "description": section.further} if section.further else False,
    }


def _key(name: str, key: Key) -> dict[str, Any]:
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
            lists = [_list(_number(key), size) for size in ([key.size] if several else sizes_of(key.size, key.expand))]
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
            return _section(name)
    return {"type": "array", "items": _section(name), "minItems": 1}


def _number(key: Key) -> dict[str, Any]:
    bounds = {"exclusiveMinimum": key.above, "minimum": key.least}
    return {"type": "number", **{word: bound for word, bound in bounds.items() if np.isfinite(bound)}}


def _list(items: dict[str, Any], size: int) -> dict[str, Any]:
    ends = {"minItems": 1} if size in (PER_JOINT, SEVERAL) else {"minItems": size, "maxItems": size}
    return {"type": "array", "items": items, **ends}
