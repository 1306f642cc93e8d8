"""``ftbias setup``: a first setup, as far as a robot's name, a URDF or a log tell it."""

from __future__ import annotations

import argparse
import json
import os
import shlex
import sys

from ftbias_jax.errors import OutputError, UsageError, printable
from ftbias_jax.io.atomic import write_atomic
from ftbias_jax.io.draft.dh_table import DhTable
from ftbias_jax.io.draft.draft import Request, draft, urdf_beside
from ftbias_jax.io.log import Log
from ftbias_jax.io.outputs import check_outputs, check_writable
from ftbias_jax.setup.keys.schema import json_schema
from ftbias_jax.setup.keys.template import Known
from ftbias_jax.setup.robots import BUILT_IN, describe_robot
from ftbias_jax.setup.types import Setup

RECORDED = ("compensated", "rezeroed")
"""Mistakes that are facts of how a log was recorded, and no error of a draft."""


def run(arguments: argparse.Namespace) -> int:
    """Write or print what is asked for; returns 0."""
    if arguments.schema:
        print(json.dumps(json_schema(), indent=1))
        return 0
    if arguments.list:
        width = max(map(len, BUILT_IN))
        print("\n".join(f"{name:{width}s}  {describe_robot(name)}" for name in BUILT_IN))
        return 0
    if not (arguments.logs or arguments.robot or arguments.urdf or arguments.dh):
        remedy = "name a built-in robot, or give --urdf FILE, --dh FILE or a LOG; --list shows the robots"
        raise UsageError("nothing says which robot", field="--robot", remedy=remedy)
    if (arguments.dh_convention or arguments.dh_units) and not arguments.dh:
        field = "--dh-convention" if arguments.dh_convention else "--dh-units"
        raise UsageError("there is no table", field=field, remedy="give the table as --dh FILE")
    output = arguments.output or ""
    if output:
        check_writable(output, ".toml")
    places = {"--output": output, "the recording's URDF": urdf_beside(output) if output else ""}
    check_outputs(places, (*arguments.logs, arguments.urdf, arguments.dh))
    if output:
        _refuse(output)
    request = Request(
        logs=arguments.logs,
        robot=arguments.robot,
        urdf=arguments.urdf,
        base_link=arguments.base,
        tip_link=arguments.tip,
        dh=DhTable(arguments.dh, arguments.dh_convention, arguments.dh_units) if arguments.dh else None,
        mass=arguments.mass,
        center_of_mass=arguments.center_of_mass,
        rate=arguments.rate,
        output=output or "setup.toml",
    )
    found = draft(request)
    if found.log is not None and (further := _recorded_so(found.setup, found.log)):
        found = draft(request._replace(further=further))
    if not output:
        print(found.text, end="")
    elif found.urdf:
        _refuse(urdf_beside(output))
        write_atomic(urdf_beside(output), lambda file: file.write(found.urdf.encode()))
    if output:
        write_atomic(output, lambda file: file.write(found.text.encode()))
    for note in found.notes:
        print(note, file=sys.stdout if output else sys.stderr)
    if output:
        print(f"wrote {output}" + (f" and {urdf_beside(output)}" if found.urdf else ""))
    if output and arguments.logs:
        print(printable(f"next: ftbias info {shlex.quote(arguments.logs[0])} --setup {shlex.quote(output)}"))
    return 0


def _recorded_so(setup: Setup, log: Log) -> dict[str, Known]:
    """Keys by which a check of the draft says that the controller compensates, or that the sensor was set to zero."""
    from ftbias_jax.check.check_setup import check_setup

    findings = check_setup(setup, [log]).findings
    return {
        key: Known(value, found.remedy.partition(":")[0])
        for found in findings
        if found.mistake in RECORDED
        for key, value in (found.setup or {}).items()
    }


def _refuse(path: str) -> None:
    """A setup that somebody has worked on is not replaced by a draft."""
    if os.path.lexists(path):
        raise OutputError("is there already", file=path, remedy="name another file, or remove it")
