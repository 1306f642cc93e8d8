"""Reading and writing setups: TOML files in which a robot's owner states robot, sensor, tool and noise."""

import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ftbias_jax.errors import UsageError, path_of
from ftbias_jax.setup.dump import dump_setup
from ftbias_jax.setup.export import save_export
from ftbias_jax.setup.fields import read_toml
from ftbias_jax.setup.parse import parse_setup
from ftbias_jax.setup.require import require_tool
from ftbias_jax.setup.save import save_setup
from ftbias_jax.setup.types import Setup

__all__ = ["GivenSetup", "Setup", "as_setup", "dump_setup", "load_setup", "parse_setup"]

GivenSetup = Setup | str | os.PathLike[str]
"""A setup, or the path of its file."""

Setup.save = save_setup  # type: ignore[method-assign, assignment]
Setup.export = save_export  # type: ignore[method-assign, assignment]


def load_setup(
    path: str | os.PathLike[str], effects: Sequence[Any] = (), *, with_tool: bool = False, allow_outside: bool = False
) -> Setup:
    """Read a setup file.

    Args:
        path: of the TOML file.
        effects: ``Effect`` objects of your own that the file may state as [effects.NAME].
        with_tool: refuse a setup that does not state the tool's mass and centre of mass.
        allow_outside: let [log.files] name files that are not in the log's folder, and addresses.

    Raises:
        SetupError: the file cannot be read, is not TOML, or states something impossible (see ``parse_setup``).
    """
    file = path_of(path, "setup")
    source, mapping = read_toml(file, "give the path of a setup.toml", "give a setup.toml, not a log")
    setup = replace(parse_setup(mapping, file), source=source).with_effects(effects)
    setup = replace(setup, log=replace(setup.log, allow_outside=allow_outside))
    return require_tool(setup) if with_tool else setup


def as_setup(setup: object, effects: Sequence[Any] = ()) -> Setup:
    """Return the setup that a verb is given, read from its file if it is a path, with further effects.

    Raises:
        UsageError: it is neither a setup nor a path. SetupError: as for ``load_setup``.
    """
    if isinstance(setup, str | os.PathLike):
        return load_setup(setup, effects)
    if not isinstance(setup, Setup):
        remedy = "give what ft.load_setup reads, or the path of a setup.toml"
        raise UsageError(f"got {type(setup).__name__}", field="setup", remedy=remedy)
    return setup.with_effects(effects)
