"""Diagnoses of many logs, each seen with its setup alone; a verdict that is there already is kept."""

from __future__ import annotations

import json
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ftbias_jax.diagnosis.diagnose import diagnose
from ftbias_jax.diagnosis.report.tables import to_json
from ftbias_jax.errors import LogError
from ftbias_jax.io import read_log
from ftbias_jax.io.atomic import make_folder, write_json
from ftbias_jax.runtime.processes import run_each
from ftbias_jax.setup import load_setup

KILLED = "its process was killed: too little memory? (give it more, or fewer --jobs)"


class Task(NamedTuple):
    """One diagnosis: all that a process is told."""

    log: Path
    setup: Path
    without: tuple[str, ...]
    """Effects that may not be named."""
    verdict: Path
    """Where to write it."""


def find_logs(folder: Path) -> list[Path]:
    """The logs of a set, in order.

    Raises:
        LogError: there are none, or one lacks its setup.
    """
    logs = sorted(folder.glob("log_*.npz"))
    if not logs:
        raise LogError("has no logs (log_*.npz)", file=folder, remedy="ftbias validate make FOLDER makes a set")
    for log in logs:
        if not log.with_suffix(".toml").exists():
            raise LogError("has no setup", file=log, remedy=f"put {log.with_suffix('.toml').name} beside it")
    return logs


def verdict_path(out: Path, log: Path) -> Path:
    """The file of a log's verdict in the folder of the verdicts."""
    return out / f"{log.stem}.json"


def diagnose_all(tasks: Sequence[Task], jobs: int, report: Callable[[int], None]) -> dict[str, str]:
    """Diagnose all that have no verdict yet.

    Several logs in one process share its compiled programs, so the first is slow and the others are not.

    Args:
        tasks: what to do.
        jobs: processes; 1 = this one.
        report: called with the number of tasks that are done.

    Returns:
        Name of a log -> why there is no diagnosis of it.

    Raises:
        OutputError: the verdicts' folder cannot be made.
    """
    for folder in {task.verdict.parent for task in tasks}:
        make_folder(folder)
    todo = [task for task in tasks if not task.verdict.exists()]
    troubles = {}
    for done, (task, trouble) in enumerate(run_each(diagnose_one, todo, jobs), len(tasks) - len(todo) + 1):
        report(done)
        if trouble != "":
            troubles[task.log.stem] = trouble or KILLED
    return troubles


def diagnose_one(task: Task) -> str:
    """Diagnose one log and write its verdict with the seconds it took; returns why not, or ""."""
    start = time.perf_counter()
    try:
        setup = load_setup(task.setup)
        diagnosis = diagnose(setup, [read_log(task.log, setup, raw=True)], [task.log.name], without=task.without)
        write_json(task.verdict, to_json(diagnosis) | {"seconds": time.perf_counter() - start})
    except Exception as error:  # one bad log must not cost the others
        last = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__}: {error} ({Path(last.filename).name}, line {last.lineno})"
    return ""


def read_verdicts(tasks: Sequence[Task]) -> dict[str, dict[str, Any]]:
    """Name of a log -> its diagnosis, for those that have one.

    Raises:
        LogError: a file is no diagnosis.
    """
    verdicts = {}
    for task in tasks:
        if not task.verdict.exists():
            continue
        try:
            said = json.loads(task.verdict.read_text())
            if not isinstance(said["verdict"], str) or not all("effect" in cause for cause in said["causes"]):
                raise ValueError("verdict or causes are not what they should be")
        except (KeyError, TypeError, ValueError) as error:
            message = f"is no diagnosis: {type(error).__name__} {error}"
            raise LogError(message, file=task.verdict, remedy="delete it, and score again") from error
        verdicts[task.log.stem] = said
    return verdicts
