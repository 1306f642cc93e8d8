"""Reading and writing setups: what the robot's owner believes, in TOML."""

import os
import re
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ftbias_jax.errors import SetupError
from ftbias_jax.setup.dump import dump_setup
from ftbias_jax.setup.export import save_export
from ftbias_jax.setup.fields import read_file
from ftbias_jax.setup.parse import parse_setup
from ftbias_jax.setup.require import require_tool
from ftbias_jax.setup.save import save_setup
from ftbias_jax.setup.types import Setup

__all__ = ["Setup", "dump_setup", "load_setup", "parse_setup"]

Setup.save = save_setup  # type: ignore[method-assign, assignment]
Setup.export = save_export  # type: ignore[method-assign, assignment]

MAX_BYTES = 1 << 20  # a setup is a page of text; anything larger is another kind of file
MOST_PARTS = 32
"""Of a dotted key: the parser's memory grows with their square."""


def load_setup(
    path: str | os.PathLike[str], effects: Sequence[Any] = (), *, with_tool: bool = False, allow_outside: bool = False
) -> Setup:
    """Read a setup file.

    Args:
        path: of the TOML file.
        effects: ``Effect`` objects of your own that it may state as [effects.NAME].
        with_tool: refuse a setup that does not state the tool's mass and centre of mass.
        allow_outside: let [log.files] name files that are not in the log's folder, and addresses.

    Raises:
        SetupError: the file cannot be read, is not TOML, or says something impossible (see ``parse_setup``).
    """
    file = os.fspath(path)
    content = read_file(file, MAX_BYTES, "give the path of a setup.toml", "give a setup.toml, not a log")
    try:
        source = content.decode()
        if _longest_key(source) > MOST_PARTS:
            raise SetupError(f"has a key of more than {MOST_PARTS} parts", file=file, remedy="write tables as [table]")
        mapping = tomllib.loads(source)
    except (ValueError, RecursionError) as error:  # broken UTF-8, broken TOML (says where), arrays nested without end
        raise SetupError(f"is not valid TOML: {error}", file=file, remedy="correct the syntax") from error
    setup = replace(parse_setup(mapping, file), source=source).with_effects(effects)
    setup = replace(setup, log=replace(setup.log, allow_outside=allow_outside))
    return require_tool(setup) if with_tool else setup


def _longest_key(source: str) -> int:
    """Parts of the longest dotted key, or of what may be one; comments left out."""
    lines = (line.partition("#")[0] for line in source.splitlines())
    return max((piece.count(".") + 1 for line in lines for piece in re.split(r"[=,\[\]{}]", line)), default=0)
