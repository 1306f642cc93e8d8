"""Keys, values and comments as TOML text."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

import numpy as np


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
