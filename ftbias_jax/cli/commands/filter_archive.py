"""``ftbias filter`` into a folder: an archive of logs, resumable, by several processes or machines."""

from __future__ import annotations

import argparse
import os
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from ftbias_jax.cli.jobs.archive import (
    FAILED,
    LOSS,
    OK,
    WAITING,
    Entry,
    done_before,
    find_logs,
    hashes,
    manifest_name,
    provenance,
    save_manifest,
    shard,
)
from ftbias_jax.errors import UsageError
from ftbias_jax.io.atomic import make_folder
from ftbias_jax.io.outputs import check_outputs
from ftbias_jax.runtime.progress import Progress
from ftbias_jax.setup import load_setup
from ftbias_jax.setup.types import Setup

SAVE_SECONDS = 1.0
"""The manifest is written at most so often; logs filtered since are filtered again if the process is killed."""


def run(arguments: argparse.Namespace) -> int:
    """Filter what is not done; 3 if logs failed or lost samples, 1 if all failed, else 0."""
    for option in ("plot", "check", "offsets"):
        if getattr(arguments, option):
            raise UsageError("needs a single log and a file for its result", field=f"--{option}", remedy="leave it out")
    setup = with_choices(load_setup(arguments.setup), arguments)
    index, count = arguments.shard
    folder = arguments.output
    every = find_logs(arguments.logs, folder, f".{arguments.format}")
    manifest = os.path.join(folder, manifest_name(index, count))
    outputs = {f"the result of {task.log!r}": os.path.join(folder, task.output) for task in every}
    check_outputs(outputs | {"the manifest": manifest}, (*(task.log for task in every), *setup.files))
    tasks = shard(every, index, count)

    from ftbias_jax.cli.jobs.filter_many import filter_task, run_tasks
    from ftbias_jax.cli.jobs.one_file import Choices

    make_folder(folder)
    choices = Choices(arguments.smooth, arguments.unchecked)
    own = tuple(arguments.own_effects)
    wanted = {**choices._asdict(), "salvage": arguments.salvage, **hashes(own)}
    known = done_before(folder)
    entries: dict[str, Entry] = {}
    for task in tasks:
        made_from = provenance(task, setup, wanted)
        before = [entry for entry in known.get(task.output, []) if entry.made_from == made_from]
        entries[task.output] = before[0]._replace(log=task.log) if before else Entry(*task, made_from=made_from)
    waiting = [task for task in tasks if entries[task.output].status == WAITING]
    save_manifest(manifest, entries.values())

    sizes = {task.output: entries[task.output].made_from["log_bytes"] for task in waiting}
    progress, done, saved = Progress(f"filtering {len(waiting)} logs", sum(sizes.values())), 0, float("-inf")
    work = partial(filter_task, setup=setup, folder=folder, choices=choices, salvage=arguments.salvage, own=own)
    for entry in run_tasks(work, waiting, arguments.jobs):
        entries[entry.output], done = entry, done + sizes[entry.output]
        progress(done)
        if time.monotonic() > saved + SAVE_SECONDS:
            save_manifest(manifest, entries.values())
            saved = time.monotonic()
    save_manifest(manifest, entries.values())
    print(format_table(list(entries.values()), len(tasks) - len(waiting)))
    print(f"wrote {manifest}")
    statuses = {entry.status for entry in entries.values()}
    return 1 if statuses == {FAILED} else 3 if statuses & {FAILED, LOSS} else 0


def with_choices(setup: Setup, arguments: argparse.Namespace) -> Setup:
    """The setup with what the command line says about the gate and about adapting to the log."""
    bias = setup.bias
    if arguments.gate is not None:
        bias = replace(bias, gate=arguments.gate)
    if arguments.as_stated:
        bias = replace(bias, adapt=False)
    return replace(setup, bias=bias)


def format_table(entries: Sequence[Entry], skipped: int) -> str:
    """A line for every log that is not whole, and the counts."""
    troubled = [entry for entry in entries if entry.status in (FAILED, LOSS)]
    lines = [f"{entry.status:9s}  {entry.error or f'{entry.log}: ' + '; '.join(entry.repairs)}" for entry in troubled]
    counts = Counter(entry.status for entry in entries)
    before = f" ({skipped} of all were done before)" if skipped else ""
    words = f"{counts[OK]} ok, {counts[LOSS]} with data loss, {counts[FAILED]} failed"
    lines.append(f"{len(entries)} logs: {words}{before}")
    return "\n".join(lines)
