"""A command over an archive of logs: resumable, by several processes or machines, one result and one line a log."""

from __future__ import annotations

import argparse
import os
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from ftbias_jax.cli.repairs import warn
from ftbias_jax.errors import UsageError, printable
from ftbias_jax.fleet.entry import FAILED, LOSS, MISTAKES, OK, Entry, Settings, is_same, state_of
from ftbias_jax.fleet.find import Task, find_logs, shard
from ftbias_jax.fleet.manifest import (
    Manifest,
    damaged_in_words,
    done_before,
    is_unchanged,
    manifest_name,
    read_manifests,
)
from ftbias_jax.fleet.table import save_table
from ftbias_jax.io.atomic import make_folder
from ftbias_jax.io.outputs import check_outputs, check_replaceable
from ftbias_jax.io.remote.fetch import shown
from ftbias_jax.io.remote.outside import check_patterns
from ftbias_jax.io.write.ours import CHECK, DIAGNOSIS, PAGE, RESULT, SETUP, kind_of
from ftbias_jax.runtime.progress import Progress
from ftbias_jax.setup import Setup

if TYPE_CHECKING:
    from ftbias_jax.cli.jobs.each_log import Work

ANSWER, REPORT, APPLIED = ".diagnosis.json", ".diagnosis.html", ".applied.toml"
"""What ``diagnose`` writes for a log, behind its path without suffix."""
VERBS = {
    "filter": "filtering",
    "check": "checking",
    "diagnose": "diagnosing",
    "identify": "identifying from",
    "tune": "tuning to",
}


def refuse_options(arguments: argparse.Namespace, options: Sequence[str]) -> None:
    """Refuse options that are for a single answer.

    Raises:
        UsageError: one of them was given.
    """
    for option in options:
        if getattr(arguments, option):
            name = f"--{option.replace('_', '-')}"
            raise UsageError("needs a single log and a file for its result", field=name, remedy="leave it out")


def find_tasks(
    arguments: argparse.Namespace, setup: Setup, job: str, suffix: str, beside: Sequence[str] = ()
) -> tuple[list[Task], str]:
    """The logs of this machine's share, and the path of its manifest; nothing would be written over an input.

    Args:
        arguments: with ``logs``, ``output`` and ``shard``.
        setup: of all logs.
        job: the command.
        suffix: of the results.
        beside: suffixes of what else is written for a log.

    Raises:
        UsageError: no log, or two files of one name. LogError: a folder cannot be read. SetupError: [log.files] leads
            out of the logs' folders.
    """
    if not setup.log.allow_outside:
        check_patterns(setup.log.files, setup.path)  # before anybody asks how large what they name is
    index, count = arguments.shard
    folder = arguments.output
    every = find_logs(arguments.logs, folder, suffix, setup.log.files)
    manifest = os.path.join(folder, manifest_name(job, index, count))
    outputs = {
        f"the result of {task.log!r}{f' ({other})' if other else ''}": os.path.join(folder, _with(task, suffix, other))
        for task in every
        for other in ("", *beside)
    }
    check_outputs(
        outputs | {"the manifest": manifest}, (*(path for task in every for path in task.paths), *setup.files)
    )
    if not arguments.force:
        _check_replaceable(folder, outputs.values(), CHECK if job == "check" else DIAGNOSIS)
    return shard(every, index, count), manifest


def _check_replaceable(folder: str, outputs: Iterable[str], answer: str) -> None:
    """Refuse a folder in which a result would replace what is neither in its manifests nor one by its content.

    Args:
        folder: of the results.
        outputs: what is written there.
        answer: what the job writes as JSON.

    Raises:
        OutputError: it names the file.
    """
    written: set[str] | None = None
    for path in filter(os.path.isfile, outputs):
        kind = {".html": PAGE, ".toml": SETUP, ".json": answer}.get(os.path.splitext(path)[1], RESULT)
        if kind_of(path) == kind:
            continue
        if written is None:
            entries = read_manifests(folder).entries.values()
            written = {name for entry in entries for name in (entry.output, *entry.sums)}
        if os.path.relpath(path, folder) not in written:
            check_replaceable(path, kind)


def _with(task: Task, suffix: str, other: str) -> str:
    return task.output.removesuffix(suffix) + (other or suffix)


def run_archive(arguments: argparse.Namespace, settings: Settings, tasks: Sequence[Task], path: str, work: Work) -> int:
    """Do what is not done, and tell what became of every log.

    Args:
        arguments: with ``output``, ``jobs`` and ``verify``.
        settings: of all logs.
        tasks: the logs.
        path: of the manifest.
        work: what to do with a log.

    Returns:
        1 if all logs failed, or the check found mistakes; 3 if some failed or lost samples; else 0.

    Raises:
        OutputError: the manifest cannot be written. LogError: one is larger than manifests get.
    """
    from ftbias_jax.cli.jobs.each_log import Job, run_tasks

    folder = arguments.output
    make_folder(folder)
    contents = read_manifests(folder)
    if contents.damaged:
        warn(f"{damaged_in_words(contents.damaged)}, their logs are done again")
    before = done_before(folder, contents)
    entries: dict[str, Entry] = {}
    sizes: dict[str, int] = {}
    with Manifest(path) as manifest:
        if contents.settings.get(settings.key) != settings:
            manifest.add("settings", settings._asdict())
        for task in tasks:
            known, now = before.get(task.output), state_of(task.paths)
            same = is_same(known.state, now, task.paths) if known and known.settings == settings.key else None
            if known and same and (not arguments.verify or is_unchanged(folder, known)):
                entries[task.output] = known._replace(
                    log=shown(task.log), files=tuple(map(shown, task.files)), state=same
                )
                if entries[task.output] != known:
                    manifest.add_entry(entries[task.output])
            else:
                sizes[task.output] = now.bytes
        waiting = [task for task in tasks if task.output in sizes]
        manifest.add("run", {"settings": settings.key, "logs": len(tasks), "waiting": len(waiting)})
        progress, done = Progress(f"{VERBS[settings.job]} {len(waiting)} logs", sum(sizes.values())), 0
        for entry in run_tasks(Job(settings.job, settings.key, folder, work), waiting, arguments.jobs):
            manifest.add_entry(entry)
            entries[entry.output], done = entry, done + sizes[entry.output]
            progress(done)
    ordered = [entries[task.output] for task in tasks]
    print(format_table(ordered, len(tasks) - len(waiting)))
    table = f"{os.path.splitext(path)[0]}.parquet"
    written = save_table(table, ordered, {**contents.settings, settings.key: settings})
    print(f"wrote {path}{f' and {table}' if written else ''}")
    return exit_code({entry.status for entry in ordered})


def exit_code(statuses: set[str]) -> int:
    """Of a command over many logs with these outcomes."""
    if statuses == {FAILED} or MISTAKES in statuses:
        return 1
    return 3 if statuses & {FAILED, LOSS} else 0


def format_table(entries: Sequence[Entry], skipped: int) -> str:
    """A line for every log that is not whole, and the counts."""
    troubled = [entry for entry in entries if entry.status != OK]
    whys = [printable(entry.error or f"{entry.log}: {'; '.join(entry.repairs)}") for entry in troubled]
    lines = [f"{entry.status:9s}  {why}" for entry, why in zip(troubled, whys, strict=True)]
    counts = Counter(entry.status for entry in entries)
    mistakes = f", {counts[MISTAKES]} with mistakes" if counts[MISTAKES] else ""
    before = f" ({skipped} of all were done before)" if skipped else ""
    words = f"{counts[OK]} ok{mistakes}, {counts[LOSS]} with data loss, {counts[FAILED]} failed"
    lines.append(f"{len(entries)} logs: {words}{before}")
    return "\n".join(lines)
