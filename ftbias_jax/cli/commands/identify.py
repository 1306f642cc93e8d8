"""``ftbias identify``: the tool's inertial parameters from a log, or from static poses."""

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ftbias_jax.cli.archive import Done, for_each_log
from ftbias_jax.cli.given import logs_of, only, save_setup, setup_of, start_jax
from ftbias_jax.cli.terminal import print_repairs
from ftbias_jax.errors import UsageError
from ftbias_jax.filtering.quality.at_rest import require_motion
from ftbias_jax.fleet.find import is_folder
from ftbias_jax.fleet.quality import of_identified
from ftbias_jax.io import read_log, read_motion
from ftbias_jax.io.log import Log
from ftbias_jax.io.tables.poses import Poses
from ftbias_jax.io.write.outputs import SETUP, output_of_setup
from ftbias_jax.io.write.provenance import provenance, source_of
from ftbias_jax.runtime.progress import Stages, silent
from ftbias_jax.setup import Setup


def run(arguments: argparse.Namespace) -> int:
    """Identify the tool and write a setup with it; returns 3 if samples were lost, else 0."""
    asked = {name: getattr(arguments, name) for name in ("mounting", "gravity", "bias", "crosstalk", "unchecked")}
    if arguments.output and is_folder(arguments.output):
        setup, of_each = setup_of(arguments), asked | {"payloads": arguments.payloads}
        return for_each_log(arguments, setup, identify_one, of_each, ".identified.toml", single=("in_place",))
    arguments.output = output_of_setup(arguments.output, arguments.setup, arguments.in_place)
    setup = setup_of(arguments)
    path = only(logs_of(arguments, setup, {"--output": SETUP}), "one setup")
    with Stages(f"identifying the tool of {Path(path).name}") as stages:
        stages("reading")
        log = read_motion(path, setup)
        if isinstance(log, Log):
            require_motion(setup, log, path)
        start_jax()
        from ftbias_jax.calibration.identify_tool import identify_tool

        setup, parts = (
            with_payloads(setup, log, path, arguments.unchecked, stages) if arguments.payloads else (setup, "")
        )
        found = identify_tool(setup, log, **asked, progress=stages)
    print(f"{parts}\n{found}" if parts else found)
    code = print_repairs([(path, log.repairs)])
    save_setup(found.save, arguments.output, arguments, "identify")
    print(f"wrote {arguments.output}")
    return code


def identify_one(path: str, output: str, setup: Setup, asked: Mapping[str, Any]) -> Done:
    """Identify the tool from one log of an archive."""
    from ftbias_jax.calibration.identify_tool import identify_tool

    log, choices = read_motion(path, setup), {**asked}
    if choices.pop("payloads", False):
        setup, _ = with_payloads(setup, log, path, choices["unchecked"])
    found = identify_tool(setup, log, **choices)
    found.save(output, by="identify")
    origin = provenance(setup, [source_of(log)], {}) if isinstance(log, Log) else {}
    return Done.of(log.repairs, origin.get("samples", len(log.t)), of_identified(found, origin))


def with_payloads(
    setup: Setup, log: Log | Poses, path: str, unchecked: bool, progress: Callable[[str], None] = silent
) -> tuple[Setup, str]:
    """Setup with the payloads that are carried in a log, and their description.

    Raises:
        UsageError: the log consists of static poses. LogError, SetupError: as in ``identify_payloads``.
    """
    if isinstance(log, Poses):
        remedy = "give a log of motion, or leave it out"
        raise UsageError("what is gripped and let go is not found from static poses", field="--payloads", remedy=remedy)
    from ftbias_jax.commissioning.payloads import identify_payloads

    found = identify_payloads(setup, read_log(path, setup, raw=True), unchecked=unchecked, progress=progress)
    return found.setup, str(found)
