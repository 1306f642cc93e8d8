"""Diagnoses of many logs, each from the log and its setup alone; existing verdicts are kept."""

from __future__ import annotations

import json
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.diagnosis.diagnose import diagnose
from ftbias_jax.diagnosis.evidence.gap import excess_by_channel
from ftbias_jax.diagnosis.problem import make_problem
from ftbias_jax.diagnosis.regression.fit import base
from ftbias_jax.diagnosis.report.as_json import to_json
from ftbias_jax.errors import LogError
from ftbias_jax.io import read_log
from ftbias_jax.io.atomic import make_folder, write_json
from ftbias_jax.io.cleaning import clean
from ftbias_jax.io.log import Log
from ftbias_jax.runtime.executors import run_each
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.setup import Setup, load_setup

KILLED = "its process was killed: too little memory? (give it more, or fewer --jobs)"


class Task(NamedTuple):
    """Everything that a process needs for one diagnosis."""

    log: Path
    setup: Path
    without: tuple[str, ...]
    """Effects that are removed from the catalogue."""
    verdict: Path
    """File for the diagnosis."""
    second: Path | None = None
    """Another log of the same robot and effect; its shrink with the findings applied is written as well."""


def find_logs(folder: Path) -> list[Path]:
    """Return the logs of a set in order.

    Raises:
        LogError: the set has no logs, or a log lacks its setup.
    """
    logs = sorted(folder.glob("log_*.npz"))
    if not logs:
        raise LogError(
            "has no logs (log_*.npz)", file=folder, remedy="python experiments/validation make FOLDER makes a set"
        )
    for log in logs:
        if not log.with_suffix(".toml").exists():
            raise LogError("has no setup", file=log, remedy=f"put {log.with_suffix('.toml').name} beside it")
    return logs


def verdict_path(out: Path, log: Path) -> Path:
    """Path of a log's verdict in the folder of the verdicts."""
    return out / f"{log.stem}.json"


def diagnose_all(tasks: Sequence[Task], jobs: int, report: Callable[[int], None]) -> dict[str, str]:
    """Diagnose all logs that have no verdict yet.

    Logs in one process share its compiled programs, so only the first one is slow.

    Args:
        tasks: diagnoses to make.
        jobs: number of processes; 1 = this process.
        report: called with the number of finished tasks.

    Returns:
        Name of a log -> reason why it has no diagnosis.

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
    """Diagnose one log and write its verdict and run time in s; returns "" or the reason for a failure."""
    start = time.perf_counter()
    try:
        setup = load_setup(task.setup)
        diagnosis = diagnose(setup, [read_log(task.log, setup, raw=True)], [task.log.name], without=task.without)
        said = to_json(diagnosis) | {"seconds": time.perf_counter() - start}
        if task.second is not None:
            said["second"] = {"shrink": shrink_of(task.second, setup, diagnosis.apply(setup))}
        write_json(task.verdict, said)
    except Exception as error:  # one bad log must not prevent the diagnosis of the others
        last = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__}: {error} ({Path(last.filename).name}, line {last.lineno})"
    return ""


def shrink_of(path: Path, setup: Setup, mended: Setup) -> float:
    """Share of a log's mean square gap that a corrected setup removes; nothing is fitted to the log."""
    if mended.effects == setup.effects:
        return 0.0
    before, after = (gap_of(stated, read_log(path, stated, raw=True)) for stated in (setup, mended))
    return float(np.clip(1 - max(after, 0.0) / before, 0.0, 1.0)) if before > 0 else 0.0


@in_float64
def gap_of(setup: Setup, log: Log) -> float:
    """Mean square gap between a log and its setup, in noise variances; may be negative by chance."""
    problem, _ = make_problem(setup, [clean(log, clipped=False, held=("q", "dq"))])
    return float(excess_by_channel(problem, base(problem).error).mean())


def read_verdicts(tasks: Sequence[Task]) -> dict[str, dict[str, Any]]:
    """Read the existing diagnoses: name of a log -> its diagnosis.

    Raises:
        LogError: a file is not a diagnosis.
    """
    verdicts = {}
    for task in tasks:
        if not task.verdict.exists():
            continue
        try:
            said = json.loads(task.verdict.read_text())
            causes, terms = said["causes"], said.get("terms", [])
            listed = all("effect" in cause for cause in causes) and all("drive" in term for term in terms)
            if not isinstance(said["verdict"], str) or not listed:
                raise ValueError("verdict, causes or terms are not what they should be")
        except (KeyError, TypeError, ValueError) as error:
            message = f"is no diagnosis: {type(error).__name__} {error}"
            raise LogError(message, file=task.verdict, remedy="delete it, and score again") from error
        verdicts[task.log.stem] = said
    return verdicts
