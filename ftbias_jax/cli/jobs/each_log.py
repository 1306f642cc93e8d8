"""What is done with one log of many, whatever becomes of the others."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any, NamedTuple

from ftbias_jax.errors import FtbiasError, printable
from ftbias_jax.fleet.entry import FAILED, Entry, state_of, with_sum
from ftbias_jax.fleet.find import Task
from ftbias_jax.io.atomic import make_folder_inside
from ftbias_jax.io.remote.fetch import forget, shown
from ftbias_jax.io.write.provenance import sha256_of
from ftbias_jax.runtime.jax_config import prepare_jax
from ftbias_jax.runtime.processes import run_each

KILLED = "its process was killed: too little memory? (give it more, or work on it alone)"


class Done(NamedTuple):
    """What became of a log that did not fail."""

    status: str
    samples: int
    remarks: tuple[str, ...]
    """What was mended or lost, and mistakes of the setup that the log shows."""
    quality: dict[str, Any]
    beside: tuple[str, ...] = ()
    """Paths of files that were written beside the result."""


Work = Callable[[str, str], Done]
"""Log and output -> what became of it; can be pickled."""


class Job(NamedTuple):
    """What a command does with every log."""

    name: str
    settings: str
    """Key of its settings."""
    folder: str
    """Of the results."""
    work: Work


def do_task(task: Task, job: Job) -> Entry:
    """Work on one log; what goes wrong is in the entry, because the other logs go on."""
    started, output = time.perf_counter(), os.path.join(job.folder, task.output)
    entry = _entry(task, job)
    try:
        entry = entry._replace(state=with_sum(state_of(task.paths), task.paths))
        make_folder_inside(job.folder, os.path.dirname(output))
        done = job.work(task.log, output)
        entry = entry._replace(
            status=done.status,
            repairs=tuple(map(printable, done.remarks)),
            samples=done.samples,
            output_bytes=os.path.getsize(output),
            quality=done.quality,
            sums={os.path.relpath(path, job.folder): sha256_of(path) or "" for path in (output, *done.beside)},
        )
    except FtbiasError as error:
        entry = entry._replace(error=str(error))
    except Exception as error:  # a bug, or no memory: this log's alone
        entry = entry._replace(error=printable(f"{shown(task.log)}: {type(error).__name__}: {error}"))
    forget()
    return entry._replace(seconds=round(time.perf_counter() - started, 4), done=round(time.time(), 3))


def run_tasks(job: Job, tasks: Iterable[Task], jobs: int) -> Iterator[Entry]:
    """Entries as they get ready, from this process (``jobs`` = 1) or from several.

    Args:
        job: what to do; it can be pickled.
        tasks: each once.
        jobs: how many at a time.
    """
    if jobs == 1:
        prepare_jax()
    for task, entry in run_each(partial(do_task, job=job), tasks, jobs):
        killed = printable(f"{shown(task.log)}: {KILLED}")
        yield entry or _entry(task, job)._replace(error=killed, done=round(time.time(), 3))


def _entry(task: Task, job: Job) -> Entry:
    """Of a log that has failed, unless more is known."""
    files = tuple(map(shown, task.files))
    return Entry(shown(task.log), task.output, job.name, FAILED, settings=job.settings, files=files)
