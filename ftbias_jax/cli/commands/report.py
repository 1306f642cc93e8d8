"""``ftbias report``: what the logs of a fleet show together, or one result, as one HTML page."""

from __future__ import annotations

import argparse
import os

from ftbias_jax.cli.terminal import warn
from ftbias_jax.errors import printable
from ftbias_jax.fleet.alarms import alarms_of
from ftbias_jax.fleet.history import read_fleet
from ftbias_jax.fleet.manifest import damaged_in_words
from ftbias_jax.fleet.page import name, to_page
from ftbias_jax.fleet.result_page import read_result, result_page
from ftbias_jax.io.atomic import write_atomic
from ftbias_jax.io.outputs import check_outputs, check_writable
from ftbias_jax.io.write.ours import PAGE


def run(arguments: argparse.Namespace) -> int:
    """Print the alarms and write the page."""
    folders, output = arguments.folders, arguments.output
    check_writable(output, ".html")
    fleet = None if len(folders) == 1 and os.path.isfile(folders[0]) else read_fleet(folders)
    reads = folders if fleet is None else [record.report for record in fleet.records if record.report]
    check_outputs({"--output": output}, reads, {"--output": PAGE}, arguments.force)
    if fleet is None:
        text = result_page(read_result(folders[0]), f"Bias of {os.path.basename(folders[0])}")
    else:
        text = to_page(fleet, f"Fleet in {', '.join(folders)}", os.path.dirname(output))
    write_atomic(output, lambda file: file.write(text.encode()))
    if fleet is not None:
        groups = fleet.by_robot()
        alarms = [
            printable(f"{name(group)}: {alarm.text}")
            for group, some in groups.items()
            for alarm in alarms_of(some, fleet.pooled.get(group, ()))
        ]
        print("\n".join([*alarms, f"{len(fleet.records)} logs of {len(groups)} robots, {len(alarms)} alarms"]))
        if fleet.damaged:
            warn(damaged_in_words(fleet.damaged))
    print(f"wrote {output}")
    return 0
