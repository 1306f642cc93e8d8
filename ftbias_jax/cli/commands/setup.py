"""``ftbias setup``: draft a setup from a robot's name, its description files or a log."""

import argparse
import json
import shlex
import sys
from functools import partial

from ftbias_jax.cli.given import write_answers
from ftbias_jax.commissioning.drafted import checked_draft
from ftbias_jax.errors import UsageError, printable
from ftbias_jax.io.draft.dh_table import DhTable
from ftbias_jax.io.draft.draft import Request, urdf_beside
from ftbias_jax.io.write.outputs import check_outputs, check_writable, refuse_existing
from ftbias_jax.setup.keys.table import json_schema
from ftbias_jax.setup.robots import BUILT_IN, describe_robot
from ftbias_jax.setup.save import write_text


def run(arguments: argparse.Namespace) -> int:
    """Write or print the draft, or print the JSON Schema or the built-in robots; returns 0."""
    if arguments.schema:
        print(json.dumps(json_schema(), indent=1))
        return 0
    if arguments.list:
        width = max(map(len, BUILT_IN))
        print("\n".join(f"{name:{width}s}  {describe_robot(name)}" for name in BUILT_IN))
        return 0
    if not (arguments.logs or arguments.robot or arguments.urdf or arguments.mjcf or arguments.dh):
        remedy = "name a built-in robot, or give --urdf FILE, --mjcf FILE, --dh FILE or a LOG; --list shows the robots"
        raise UsageError("nothing says which robot", field="--robot", remedy=remedy)
    if (arguments.dh_convention or arguments.dh_units) and not arguments.dh:
        field = "--dh-convention" if arguments.dh_convention else "--dh-units"
        raise UsageError("there is no table", field=field, remedy="give the table as --dh FILE")
    output = arguments.output or ""
    if output:
        check_writable(output, ".toml")
    inputs = (*arguments.logs, arguments.urdf, arguments.mjcf, arguments.dh)
    check_outputs({"--output": output}, inputs)
    if output:
        refuse_existing(output)
    same = {name: getattr(arguments, name) for name in ("logs", "robot", "urdf", "mjcf", "site", "mass", "rate")}
    request = Request(
        **same,
        base_link=arguments.base,
        tip_link=arguments.tip,
        dh=DhTable(arguments.dh, arguments.dh_convention, arguments.dh_units) if arguments.dh else None,
        center_of_mass=arguments.center_of_mass,
        output=output or "setup.toml",
    )
    found = checked_draft(request)
    if not output:
        print(found.text, end="")
    for note in found.notes:
        print(note, file=sys.stdout if output else sys.stderr)
    if found.urdf and output:
        check_outputs({"the recording's URDF": urdf_beside(output)}, inputs)
        refuse_existing(urdf_beside(output))
    texts = {urdf_beside(output): found.urdf, output: found.text} if output and found.urdf else {output: found.text}
    write_answers({path: partial(write_text, text=text) for path, text in texts.items()})
    if output and arguments.logs:
        print(printable(f"next: ftbias info {shlex.quote(arguments.logs[0])} --setup {shlex.quote(output)}"))
    return 0
