"""Two protocols on a labelled set: diagnosis with the whole catalogue, and with the true effect removed from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ftbias_jax.runtime.progress import Progress
from validation import tables
from validation.labels import Label, read_labels
from validation.rules import FAILED
from validation.runs import Task, diagnose_all, read_verdicts, verdict_path


class Score(NamedTuple):
    """Result of a protocol."""

    text: str
    """Tables for a reader."""
    content: dict[str, Any]
    """The same and more for programs."""
    troubles: Mapping[str, str]
    """Log -> reason why it has no diagnosis."""
    losses: tuple[str, ...] = ()
    """Messages about samples that were left out of the logs."""


def withheld(folder: Path, logs: Sequence[Path], out: Path, jobs: int) -> Score:
    """Diagnose every log from the log and its setup alone, then open the labels and score.

    Args:
        folder: folder of the set.
        logs: logs of the set.
        out: folder of the verdicts.
        jobs: processes.

    Raises:
        LogError: labels or verdicts cannot be read. OutputError: a verdict cannot be written.
    """
    tasks = [Task(log, log.with_suffix(".toml"), (), verdict_path(out, log), _second(log)) for log in logs]
    said, troubles = _diagnosed(tasks, jobs)
    labels = read_labels(folder, [log.stem for log in logs])
    pairs = {name: (label, said.get(name, dict(FAILED))) for name, label in labels.items()}
    return Score(tables.withheld_text(pairs), tables.withheld_content(pairs), troubles, _losses(said))


def leave_one_out(folder: Path, logs: Sequence[Path], out: Path, jobs: int) -> Score:
    """Diagnose every log of one catalogue effect that is not faint, with that effect removed from the catalogue.

    The diagnosis uses the label only to remove this effect. Arguments and errors are those of ``withheld``.
    """
    labels = read_labels(folder, [log.stem for log in logs])
    asked = {log: label for log in logs if (label := labels[log.stem]).group == "single"}
    tasks = [
        Task(log, log.with_suffix(".toml"), tuple(label.effects), verdict_path(out, log))
        for log, label in asked.items()
    ]
    said, troubles = _diagnosed(tasks, jobs)
    pairs: dict[str, tuple[Label, dict[str, Any]]] = {
        log.stem: (label, said.get(log.stem, dict(FAILED))) for log, label in asked.items()
    }
    return Score(tables.left_out_text(pairs), tables.left_out_content(pairs), troubles, _losses(said))


def _second(log: Path) -> Path | None:
    """Second log with the same robot and effect in another motion, which sets of unlisted kinds contain; else None."""
    path = log.parent / "second" / log.name
    return path if path.exists() else None


def _losses(said: Mapping[str, Mapping[str, Any]]) -> tuple[str, ...]:
    return tuple(str(loss) for verdict in said.values() for loss in verdict.get("losses", ()))


def _diagnosed(tasks: Sequence[Task], jobs: int) -> tuple[dict[str, dict[str, Any]], dict[str, str]]:
    troubles = diagnose_all(tasks, jobs, Progress(f"diagnosing {len(tasks)} logs", len(tasks)))
    return read_verdicts(tasks), troubles
