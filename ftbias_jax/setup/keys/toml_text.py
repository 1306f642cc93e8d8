"""Keys, values and comments as TOML text; a whole setup for a person to finish: what is known, and what to measure."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.setup.keys.table import SECTIONS, Kind

MEASURE = "measure me"
TO_MEASURE = ("sensor.translation", "sensor.rotation_rpy", "sensor.noise_std", "tool.mass", "tool.center_of_mass")
"""Keys that a prediction of the wrench needs, and that only the owner knows."""
ALWAYS = ("robot", "sensor", "tool", "bias", "joints")
"""Sections that are written whether anything of them is known or not."""


def toml_line(key: str, value: Any, comment: str = "") -> str:
    """``key = value  # comment``, without the end of the line."""
    return f"{toml_key(key)} = {toml_value(value)}{toml_comment(comment)}"


def toml_comment(words: str) -> str:
    """A comment behind a value; nothing if there are no words."""
    printable = "".join(c if c.isprintable() else " " for c in words)  # TOML forbids control characters here
    return f"  # {printable}" if printable else ""


def toml_key(key: str) -> str:
    """A key, in quotes if it needs them."""
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _string(key)


def toml_value(value: Any) -> str:
    """A value that ``tomllib`` reads back to the last bit."""
    match value:
        case bool() | np.bool_():
            return "true" if value else "false"
        case str():
            return _string(value)
        case int() | np.integer():
            return str(int(value))
        case float() | np.floating():
            return repr(float(value))
        case list() | tuple() | np.ndarray():
            return f"[{', '.join(toml_value(item) for item in value)}]"
        case Mapping():
            return "{" + ", ".join(f"{toml_key(key)} = {toml_value(item)}" for key, item in value.items()) + "}"
    return str(value.isoformat())  # TOML's dates and times are Python's


def _string(text: str) -> str:
    # JSON's escapes are TOML's, but for DEL, which JSON leaves bare.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


class Known(NamedTuple):
    """The value of one key, and where it is from."""

    value: Any
    """None = it is left to choose: a comment says of what."""
    remark: str = ""


def write_template(known: Mapping[str, Known], about: str = "") -> str:
    """The text of a setup: what is known of full keys such as ``sensor.noise_std``, below lines on what it is about.

    The other keys of the sections become comments; those of TO_MEASURE say so.
    """
    parts = ["".join(f"#{toml_comment(line)[3:]}\n" if line else "#\n" for line in about.splitlines())]
    for name in SECTIONS:
        stated = {key: known[f"{name}.{key}"] for key in SECTIONS[name].keys if f"{name}.{key}" in known}
        if name in ALWAYS or stated:
            parts.append(_section(name, stated, known))
    return "\n".join(part for part in parts if part)


def _section(name: str, known: Mapping[str, Known], everything: Mapping[str, Known]) -> str:
    section = SECTIONS[name]
    # Of the robot, only gravity goes with a recorded pose.
    elsewhere = name == "robot" and "sensor_pose.orientation" in everything
    lines = [f"[{name}]  # {section.about}"]
    for key, spec in section.keys.items():
        value, remark = known.get(key, ("", ""))
        shown = spec.example if spec.default is None else spec.default
        if value is None:
            lines.append(f"# {key} = ...  # {spec.meaning}; {toml_comment(remark)[4:]}")
        elif key in known:
            lines.append(toml_line(key, value, _joined(spec.unit, remark)))
        elif shown is not None and spec.kind is not Kind.ROWS and not (elsewhere and key != "gravity"):
            absent = f"default: {spec.absent}" if spec.absent else ""
            words = (MEASURE,) if f"{name}.{key}" in TO_MEASURE else (spec.meaning, absent)
            lines.append(f"# {toml_line(key, shown, _joined(spec.unit, *words))}")
    return "\n".join(lines) + "\n"


def _joined(*words: str) -> str:
    return "; ".join(filter(None, words))
