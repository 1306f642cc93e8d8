"""``ftbias report``: one HTML page with the results of a fleet of robots, or of a single log."""

import argparse
import os

from ftbias_jax.cli.terminal import warn
from ftbias_jax.errors import printable
from ftbias_jax.fleet.alarms import alarms_of
from ftbias_jax.fleet.history import read_fleet
from ftbias_jax.fleet.manifest import damaged_in_words
from ftbias_jax.fleet.page import name as name_of
from ftbias_jax.fleet.page import to_page
from ftbias_jax.fleet.place import Place
from ftbias_jax.fleet.result_page import read_result, result_page
from ftbias_jax.io.remote import is_url
from ftbias_jax.io.write.outputs import PAGE, check_outputs, check_replaceable, check_writable
from ftbias_jax.setup.save import write_text


def run(arguments: argparse.Namespace) -> int:
    """Print the alarms and write the page."""
    folders, output = arguments.folders, arguments.output
    place, page = Place(os.path.dirname(output)), os.path.basename(output)
    check_writable(page if is_url(output) else output, ".html")
    first, name = folders[0], os.path.basename(folders[0])
    is_single = len(folders) == 1 and (bool(os.path.splitext(name)[1]) if is_url(first) else os.path.isfile(first))
    fleet = None if is_single else read_fleet(folders)
    reads = folders if fleet is None else [record.report for record in fleet.records if record.report]
    check_outputs({"--output": output}, reads)
    if not arguments.force:
        with place.reading([page]) as folder:
            check_replaceable(os.path.join(folder, page), PAGE)
    if fleet is None:
        with Place(os.path.dirname(first)).reading([name]) as folder:
            text = result_page(read_result(os.path.join(folder, name)), f"Bias of {name}")
    else:
        text = to_page(fleet, f"Fleet in {', '.join(folders)}", os.path.dirname(output))
    with place.writing() as folder:
        write_text(os.path.join(folder, page), text)
    if fleet is not None:
        groups = fleet.by_robot()
        alarms = [
            printable(f"{name_of(group)}: {alarm.text}")
            for group, some in groups.items()
            for alarm in alarms_of(some, fleet.pooled.get(group, ()))
        ]
        logs, robots = _counted(len(fleet.records), "log"), _counted(len(groups), "robot")
        print("\n".join([*alarms, f"{logs} of {robots}, {_counted(len(alarms), 'alarm')}"]))
        if fleet.damaged:
            warn(damaged_in_words(fleet.damaged))
    print(f"wrote {output}")
    return 0


def _counted(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
