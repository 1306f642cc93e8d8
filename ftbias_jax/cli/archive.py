"""Commands over archives of logs: resumable, on several processes or machines, one result and manifest line per log."""

from __future__ import annotations

import argparse
import os
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

from ftbias_jax.cli.terminal import warn
from ftbias_jax.errors import FtbiasError, UsageError, printable
from ftbias_jax.fleet.entry import FAILED, LOSS, MISTAKES, OK, Entry, Settings, is_same, settings_of, state_of, with_sum
from ftbias_jax.fleet.find import Task, find_logs, shard
from ftbias_jax.fleet.manifest import (
    Contents,
    Manifest,
    contents_of,
    damaged_in_words,
    done_before,
    is_unchanged,
    manifest_name,
)
from ftbias_jax.fleet.place import Place
from ftbias_jax.fleet.table import save_table
from ftbias_jax.io.atomic import make_folder_inside
from ftbias_jax.io.log import Repairs
from ftbias_jax.io.remote import check_patterns, forget, from_anywhere, without_credentials
from ftbias_jax.io.write import written
from ftbias_jax.io.write.outputs import CHECK, DIAGNOSIS, PAGE, RESULT, SETUP, check_outputs, check_replaceable
from ftbias_jax.io.write.provenance import sha256_of
from ftbias_jax.runtime.progress import Progress
from ftbias_jax.setup import Setup

VERBS = {
    "filter": "filtering",
    "check": "checking",
    "diagnose": "diagnosing",
    "identify": "identifying from",
    "tune": "tuning to",
}
BUNDLE = 1.0
"""s; target duration of the bundle of tasks that a worker of a cluster receives at a time."""
KILLED = "its process was killed: too little memory? (give it more, or work on it alone)"


class Done(NamedTuple):
    """Outcome of a log that did not fail."""

    status: str
    samples: int
    remarks: tuple[str, ...]
    """Repairs and losses of samples, and mistakes of the setup that the log shows."""
    quality: dict[str, Any]
    beside: tuple[str, ...] = ()
    """Paths of further files that were written for the log."""

    @classmethod
    def of(cls, repairs: Repairs, samples: int, quality: dict[str, Any]) -> Done:
        """Outcome of a log whose only remarks are its repairs; its status is LOSS if one of them lost samples."""
        status = LOSS if any(repair.lost for repair in repairs) else OK
        return cls(status, samples, tuple(repair.what for repair in repairs), quality)


Work = Callable[[str, str, Setup, Mapping[str, Any]], Done]
"""Function (log, output, setup, options) -> outcome of the log; must be picklable."""


class Job(NamedTuple):
    """Work of a command on every log of an archive; picklable."""

    settings: Settings
    place: Place
    """Location of the results."""
    work: Work
    setup: Setup
    asked: Mapping[str, Any]
    own: tuple[str, ...] = ()
    """Files or packages of the user's own effects; every process imports them, because code cannot be sent to it."""


def for_each_log(
    arguments: argparse.Namespace,
    setup: Setup,
    work: Work,
    asked: Mapping[str, Any],
    suffix: str,
    *,
    single: Sequence[str],
    beside: Sequence[str] = (),
) -> int:
    """Run a command on every log separately, into a folder, skip logs that are done, and print every outcome.

    Args:
        arguments: parsed arguments of the command.
        setup: setup of all logs.
        work: function that processes one log.
        asked: options on which the results depend in addition to the setup, plain numbers and strings.
        suffix: suffix of the results.
        single: options that are only valid for a single result.
        beside: suffixes of further files that are written for each log.

    Returns:
        1 if all logs failed, or the check found mistakes; 3 if some failed or lost samples; else 0.

    Raises:
        UsageError: an option for a single result is given, there is no log, or two files have the same name. LogError:
            a folder cannot be read, or a manifest exceeds its maximum size. SetupError: [log.files] leads out of the
            logs' folders. OutputError: the manifest cannot be written.
    """
    for option in single:
        if getattr(arguments, option):
            name = f"--{option.replace('_', '-')}"
            raise UsageError("needs a single log and a file for its result", field=name, remedy="leave it out")
    place = Place(arguments.output)
    contents = contents_of(place)
    tasks, name = _find_tasks(arguments, setup, suffix, beside, contents)
    own = tuple(getattr(arguments, "own_effects", ()))
    settings = settings_of(arguments.command, setup, asked, own)
    job = Job(settings, place, work, setup, asked, own)
    if contents.damaged:
        warn(f"{damaged_in_words(contents.damaged)}, their logs are done again")
    before = done_before(place, contents)
    entries: dict[str, Entry] = {}
    sizes: dict[str, int] = {}
    with place.growing(name) as growing, Manifest(*growing) as manifest:
        if contents.settings.get(settings.key) != settings:
            manifest.add("settings", settings._asdict())
        for task in tasks:
            known, now = before.get(task.output), state_of(task.paths)
            same = is_same(known.state, now, task.paths) if known and known.settings == settings.key else None
            if known and same and (not arguments.verify or is_unchanged(place, known)):
                entry = known._replace(
                    log=without_credentials(task.log), files=tuple(map(without_credentials, task.files)), state=same
                )
                entries[task.output] = entry
                if entry != known:
                    manifest.add_entry(entry)
            else:
                sizes[task.output] = now.bytes
        waiting = [task for task in tasks if task.output in sizes]
        manifest.add("run", {"settings": settings.key, "logs": len(tasks), "waiting": len(waiting)})
        progress, done = Progress(f"{VERBS[settings.job]} {len(waiting)} logs", sum(sizes.values())), 0
        for entry in run_tasks(job, waiting, arguments.jobs, arguments.executor):
            manifest.add_entry(entry)
            entries[entry.output], done = entry, done + sizes[entry.output]
            progress(done)
    ordered = [entries[task.output] for task in tasks]
    print(_table(ordered, len(tasks) - len(waiting)))
    table = f"{os.path.splitext(name)[0]}.parquet"
    with place.writing() as folder:
        saved = save_table(os.path.join(folder, table), ordered, {**contents.settings, settings.key: settings})
    print(f"wrote {place.path(name)}{f' and {place.path(table)}' if saved else ''}")
    statuses = {entry.status for entry in ordered}
    if statuses == {FAILED} or MISTAKES in statuses:
        return 1
    return 3 if statuses & {FAILED, LOSS} else 0


def _find_tasks(
    arguments: argparse.Namespace, setup: Setup, suffix: str, beside: Sequence[str], contents: Contents
) -> tuple[list[Task], str]:
    """This machine's share of the logs and the name of its manifest, after a check that no input is overwritten."""
    if not setup.log.allow_outside:
        check_patterns(setup.log.files, setup.path)  # before the sizes of the named files are queried
    (index, count), place, command = arguments.shard, Place(arguments.output), arguments.command
    every = find_logs(arguments.logs, place.root, suffix, setup.log.files)
    manifest = manifest_name(command, index, count)
    names = {
        f"the result of {task.log!r}{other and f' ({other})'}": task.output.removesuffix(suffix) + (other or suffix)
        for task in every
        for other in ("", *beside)
    }
    outputs = {what: os.path.join(place.root, name) for what, name in (*names.items(), ("the manifest", manifest))}
    check_outputs(outputs, (*(path for task in every for path in task.paths), *setup.files))
    if not arguments.force:
        known = {name for entry in contents.entries.values() for name in (entry.output, *entry.sums)}
        answer = CHECK if command == "check" else DIAGNOSIS
        _check_replaceable(place, place.sizes(name for name in names.values() if name not in known), answer)
    return shard(every, index, count), manifest


def _check_replaceable(place: Place, names: Iterable[str], answer: str) -> None:
    """Refuse to replace files that no manifest lists and that this program did not write, judging by their content."""
    for name in names:
        kind = {".html": PAGE, ".toml": SETUP, ".json": answer}.get(os.path.splitext(name)[1], RESULT)
        with place.reading(written(name)) as folder:
            check_replaceable(os.path.join(folder, name), kind)


def run_tasks(job: Job, tasks: Iterable[Task], jobs: int, executor: str | None = None) -> Iterator[Entry]:
    """Yield entries as they become ready, from this process (``jobs`` = 1), ``jobs`` processes or a cluster."""
    named = {task.output: task for task in tasks}
    if executor:  # its workers have other working directories
        own = tuple(from_anywhere(one) if os.path.isfile(one) else one for one in job.own)  # or names of packages
        job = job._replace(place=Place(from_anywhere(job.place.root)), own=own)
    work = partial(do_task, job=job)
    all_tasks = named.values()
    for done, entry in _on_cluster(executor, work, all_tasks, jobs) if executor else _here(work, all_tasks, jobs):
        task = named[done.output]
        killed = printable(f"{without_credentials(task.log)}: {KILLED}")
        entry = entry or _entry(task, job)._replace(error=killed, done=round(time.time(), 3))
        yield entry._replace(log=without_credentials(task.log), files=tuple(map(without_credentials, task.files)))


def _here(work: Callable[[Task], Entry], tasks: Iterable[Task], jobs: int) -> Iterator[tuple[Task, Entry | None]]:
    from ftbias_jax.runtime.executors import run_each
    from ftbias_jax.runtime.jax_config import prepare_jax

    if jobs == 1:
        prepare_jax()
    yield from run_each(work, tasks, jobs)


def _on_cluster(
    name: str, work: Callable[[Task], Entry], tasks: Iterable[Task], jobs: int
) -> Iterator[tuple[Task, Entry | None]]:
    from ftbias_jax.runtime.executors import IN_FLIGHT, executor_of, run_with

    everywhere = (
        task._replace(log=from_anywhere(task.log), files=tuple(map(from_anywhere, task.files))) for task in tasks
    )
    with executor_of(name) as executor:
        yield from run_with(executor, work, everywhere, jobs if jobs > 1 else IN_FLIGHT, BUNDLE)


def do_task(task: Task, job: Job) -> Entry:
    """Process one log; an error is recorded in its entry, because the other logs are still to be processed."""
    started, entry = time.perf_counter(), _entry(task, job)
    try:
        entry = entry._replace(state=with_sum(state_of(task.paths), task.paths))
        setup = job.setup
        if job.own:
            from ftbias_jax.model.own_effects import load_all

            setup = setup.with_effects(load_all(job.own))
        with job.place.writing() as folder:
            output = os.path.join(folder, task.output)
            make_folder_inside(folder, os.path.dirname(output))
            done = job.work(task.log, output, setup, job.asked)
            found = entry._replace(
                status=done.status,
                repairs=tuple(map(printable, done.remarks)),
                samples=done.samples,
                output_bytes=os.path.getsize(output),
                quality=done.quality,
                sums={os.path.relpath(path, folder): sha256_of(path) or "" for path in (output, *done.beside)},
            )
        entry = found
    except FtbiasError as error:
        entry = entry._replace(error=str(error))
    except Exception as error:  # a bug or lack of memory must not stop the other logs
        entry = entry._replace(error=printable(f"{without_credentials(task.log)}: {type(error).__name__}: {error}"))
    forget()
    return entry._replace(seconds=round(time.perf_counter() - started, 4), done=round(time.time(), 3))


def _entry(task: Task, job: Job) -> Entry:
    """Entry of a failed log, completed later if the log succeeds."""
    files = tuple(map(without_credentials, task.files))
    return Entry(
        without_credentials(task.log), task.output, job.settings.job, FAILED, settings=job.settings.key, files=files
    )


def _table(entries: Sequence[Entry], skipped: int) -> str:
    """Text with a line for every log whose status is not OK, and the number of logs by status."""
    troubled = [entry for entry in entries if entry.status != OK]
    whys = [printable(entry.error or f"{entry.log}: {'; '.join(entry.repairs)}") for entry in troubled]
    lines = [f"{entry.status:9s}  {why}" for entry, why in zip(troubled, whys, strict=True)]
    counts = Counter(entry.status for entry in entries)
    mistakes = f", {counts[MISTAKES]} with mistakes" if counts[MISTAKES] else ""
    before = f" ({skipped} of all were done before)" if skipped else ""
    words = f"{counts[OK]} ok{mistakes}, {counts[LOSS]} with data loss, {counts[FAILED]} failed"
    lines.append(f"{len(entries)} logs: {words}{before}")
    return "\n".join(lines)
