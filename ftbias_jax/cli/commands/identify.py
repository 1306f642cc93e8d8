"""``ftbias identify``: the tool's inertial parameters from a log, or from static poses."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from ftbias_jax.cli.jobs.many import find_tasks, refuse_options, run_archive
from ftbias_jax.cli.repairs import tell_repairs
from ftbias_jax.errors import UsageError
from ftbias_jax.filtering.quality.at_rest import require_motion
from ftbias_jax.fleet.entry import settings_of
from ftbias_jax.fleet.find import expand, inputs, is_folder
from ftbias_jax.io import read_motion
from ftbias_jax.io.log import Log
from ftbias_jax.io.outputs import behind_link, check_outputs, output_of_setup
from ftbias_jax.io.write.ours import SETUP
from ftbias_jax.setup import load_setup


def run(arguments: argparse.Namespace) -> int:
    """Identify the tool and write a setup that has it; 3 if samples were lost."""
    if arguments.output and is_folder(arguments.output):
        return _each(arguments)
    output, kept = output_of_setup(arguments.output, arguments.setup, arguments.in_place)
    setup = load_setup(arguments.setup, allow_outside=arguments.allow_outside)
    logs = expand(arguments.logs, setup.log.files)
    if len(logs) > 1:
        remedy = "give -o a folder's name, without a suffix"
        raise UsageError(f"{len(logs)} logs for one setup", field="-o", remedy=remedy)
    (path,) = logs
    kinds = {} if arguments.in_place else {"--output": SETUP}
    check_outputs({"--output": output}, (*inputs(logs, setup.log.files), *kept, setup.urdf), kinds, arguments.force)

    from ftbias_jax.runtime.jax_config import prepare_jax
    from ftbias_jax.runtime.progress import Stages

    with Stages(f"identifying the tool of {Path(path).name}") as stages:
        stages("reading")
        log = read_motion(path, setup)
        if isinstance(log, Log):
            require_motion(setup, log, path)
        prepare_jax()
        from ftbias_jax.calibration.identify_tool import identify_tool

        found = identify_tool(setup, log, **_asked(arguments), progress=stages)
    print(found)
    code = tell_repairs([(path, log.repairs)])
    found.save(behind_link(output, arguments.in_place), by="" if arguments.in_place else "identify")
    print(f"wrote {output}")
    return code


def _each(arguments: argparse.Namespace) -> int:
    """From every log by itself, into a folder."""
    refuse_options(arguments, ("in_place",))
    setup = load_setup(arguments.setup, allow_outside=arguments.allow_outside)
    tasks, manifest = find_tasks(arguments, setup, "identify", ".identified.toml")

    from ftbias_jax.cli.jobs.work import identify_one

    asked = _asked(arguments)
    work = partial(identify_one, setup=setup, asked=asked)
    return run_archive(arguments, settings_of("identify", setup, asked), tasks, manifest, work)


def _asked(arguments: argparse.Namespace) -> dict[str, bool]:
    """Named arguments of ``identify_tool``."""
    return {name: getattr(arguments, name) for name in ("mounting", "gravity", "bias", "crosstalk", "unchecked")}
