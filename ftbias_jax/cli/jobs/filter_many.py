"""Logs of an archive filtered, each whatever becomes of the others."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator

from ftbias_jax.cli.jobs.archive import FAILED, LOSS, OK, Entry, Task, hashes, provenance
from ftbias_jax.cli.jobs.one_file import Choices, filter_file
from ftbias_jax.errors import FtbiasError, printable
from ftbias_jax.io.atomic import make_folder
from ftbias_jax.io.parts import open_log
from ftbias_jax.model.own_effects import load_all
from ftbias_jax.runtime.jax_config import prepare_jax
from ftbias_jax.runtime.processes import run_each
from ftbias_jax.setup.types import Setup

KILLED = "its process was killed: too little memory? (give it more, or filter it alone)"

Work = Callable[[Task], Entry]


def filter_task(
    task: Task, setup: Setup, folder: str, choices: Choices, salvage: bool = False, own: tuple[str, ...] = ()
) -> Entry:
    """Filter one log of an archive; what goes wrong is in the entry, because the other logs go on.

    Args:
        task: the log.
        setup: of all logs.
        folder: of the results.
        choices: as of the command.
        salvage: as of the command.
        own: where effects of one's own are; every process runs their code itself, because code cannot be sent to it.
    """
    made_from = provenance(task, setup, {**choices._asdict(), "salvage": salvage, **hashes(own)})
    entry = Entry(*task, status=FAILED, made_from=made_from)
    output = os.path.join(folder, task.output)
    try:
        make_folder(os.path.dirname(output))
        setup = setup.with_effects(load_all(own))
        outcome = filter_file(open_log(task.log, setup, salvage=salvage), setup, output, choices)
    except FtbiasError as error:
        return entry._replace(error=str(error))
    except Exception as error:  # a bug, or no memory: this log's alone
        return entry._replace(error=printable(f"{task.log}: {type(error).__name__}: {error}"))
    return entry._replace(
        status=LOSS if outcome.lost else OK,
        repairs=tuple(map(printable, (*outcome.warnings, *(repair.what for repair in outcome.repairs)))),
        samples=outcome.summary.samples,
        output_bytes=os.path.getsize(output),
    )


def run_tasks(work: Work, tasks: Iterable[Task], jobs: int) -> Iterator[Entry]:
    """Entries as they get ready, from this process (``jobs`` = 1) or from several.

    Args:
        work: what to do; it can be pickled.
        tasks: each once.
        jobs: how many at a time.
    """
    if jobs == 1:
        prepare_jax()
    for task, entry in run_each(work, tasks, jobs):
        yield entry or Entry(*task, status=FAILED, error=printable(f"{task.log}: {KILLED}"))
