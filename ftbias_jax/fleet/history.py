"""Merge the manifests of folders into one record per log, by robot and sensor, in order of time."""

import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.diagnosis.report.as_json import load_courses
from ftbias_jax.diagnosis.result import Course
from ftbias_jax.errors import UsageError
from ftbias_jax.fleet.entry import FAILED, LOSS, OK, Entry, Settings, seconds_of
from ftbias_jax.fleet.manifest import Contents, read_manifests
from ftbias_jax.fleet.place import Place
from ftbias_jax.types import Array

UNKNOWN = "not named"
POOLED = ".pooled.json"
"""Suffix of diagnoses of pooled logs, which belong to the robot whose setup they name."""


class FleetLog(NamedTuple):
    """Record of one log, merged from all commands."""

    log: str
    robot: str
    sensor: str
    date: float
    """Start of the log by its own stamps, or else the last modification of its file, s since 1970."""
    dated: bool
    """Whether the date is from the log's own stamps."""
    status: str
    """Worst status of all commands: FAILED, LOSS or OK."""
    troubles: tuple[str, ...]
    """Errors, and repairs and losses of samples."""
    quality: Mapping[str, Any]
    """Quality metrics of all commands together."""
    report: str
    """Path or URL of the report of its diagnosis; "" = there is none."""

    def numbers(self, name: str, count: int = 6) -> Array:
        """(count,) values of a quality metric; NaN where unknown."""
        values = self.quality.get(name)
        found = values if isinstance(values, list) else [values]
        return np.array(found, float) if len(found) == count else np.full(count, np.nan)  # None becomes NaN

    def words(self, name: str) -> tuple[str, ...]:
        """Strings of a quality metric, such as the causes."""
        return tuple(self.quality.get(name) or ())

    @property
    def verdict(self) -> str:
        """Verdict of the diagnosis; "" = not diagnosed."""
        return self.quality.get("verdict") or ""

    @property
    def has_gap(self) -> bool:
        """Whether the diagnosis found a gap."""
        return self.verdict not in ("", "none")


class Fleet(NamedTuple):
    """All logs that were processed."""

    records: tuple[FleetLog, ...]
    """Records in order of time."""
    settings: tuple[Settings, ...]
    folders: tuple[str, ...]
    """Folders that have a manifest."""
    damaged: int
    """Number of lines of manifests that could not be read."""
    pooled: Mapping[tuple[str, str], tuple[Course, ...]]
    """(robot, sensor) -> time courses of the causes found in its pooled logs (``ftbias diagnose --pool``)."""

    def by_robot(self) -> dict[tuple[str, str], list[FleetLog]]:
        """Records by (robot, sensor), sorted by name."""
        groups: dict[tuple[str, str], list[FleetLog]] = {}
        for record in self.records:
            groups.setdefault((record.robot, record.sensor), []).append(record)
        for group in self.pooled:
            groups.setdefault(group, [])
        return dict(sorted(groups.items()))


def read_fleet(folders: Sequence[str]) -> Fleet:
    """Read all manifests in folders of results and below them.

    Raises:
        UsageError: there is no manifest. LogError: a manifest exceeds its maximum size.
    """
    found, reports, courses = list[tuple[str, Contents]](), set[str](), dict[str, tuple[Course, ...]]()
    for archive in map(Place, folders):
        names, together = archive.named(), archive.named(f"*{POOLED}")
        with archive.reading([*names, *together]) as here:
            courses |= dict(load_courses(os.path.join(here, name)) for name in together)
            inner = sorted(set(map(os.path.dirname, names)))
            read = [(folder, read_manifests(os.path.join(here, folder))) for folder in inner]
        pages = {os.path.join(folder, _report_of(entry)) for folder, some in read for entry in some.entries.values()}
        reports |= set(map(archive.path, archive.sizes(pages)))
        found += [(archive.path(folder), contents) for folder, contents in read]
    damaged = sum(contents.damaged for _, contents in found)
    found = [(place, contents) for place, contents in found if contents.entries]
    if not found:
        remedy = "give folders that ftbias filter, check or diagnose have written into"
        raise UsageError(f"no manifest in {', '.join(folders)}", field="FOLDER", remedy=remedy)
    settings = {key: one for _, contents in found for key, one in contents.settings.items()}
    entries: dict[tuple[str, str, str], list[tuple[str, Entry]]] = {}
    for place, contents in found:
        for entry in contents.entries.values():
            used = settings.get(entry.settings)
            log = entry.state.sha256 or os.path.abspath(entry.log)
            name = (used.robot, used.sensor) if used else ("", "")
            entries.setdefault((*name, log), []).append((place, entry))
    records = [_record(robot, sensor, of_log, reports) for (robot, sensor, _), of_log in entries.items()]
    ordered = sorted(records, key=lambda record: (record.date, record.log))
    known = {os.path.basename(one.setup): (one.robot or UNKNOWN, one.sensor) for one in settings.values()}
    pooled = {known.get(of_setup, (of_setup, "")): some for of_setup, some in courses.items()}
    return Fleet(tuple(ordered), tuple(settings.values()), tuple(place for place, _ in found), damaged, pooled)


def _report_of(entry: Entry) -> str:
    """Path of a log's report, if it exists, relative to the folder of the manifest."""
    return f"{os.path.splitext(entry.output)[0]}.html"


def _record(robot: str, sensor: str, entries: Iterable[tuple[str, Entry]], there: Collection[str]) -> FleetLog:
    """Record of one log from the entries of several commands; where they disagree, the latest one is valid.

    Args:
        robot: name of the robot.
        sensor: name of the sensor.
        entries: place of the manifest and entry, for each command.
        there: paths of existing reports.
    """
    placed = sorted(entries, key=lambda item: item[1].done)
    every = [entry for _, entry in placed]
    quality: dict[str, Any] = {}
    for entry in every:
        quality |= {name: value for name, value in entry.quality.items() if value is not None or name not in quality}
    statuses = {entry.status for entry in every}
    date = quality.get("date")
    reports = [Place(place).path(_report_of(entry)) for place, entry in placed]
    return FleetLog(
        log=every[-1].log,
        robot=robot or UNKNOWN,
        sensor=sensor,
        date=every[-1].state.modified_ns / 1e9 if date is None else seconds_of(date),
        dated=date is not None,
        status=FAILED if FAILED in statuses else LOSS if LOSS in statuses else OK,
        troubles=tuple(dict.fromkeys(x for e in every for x in ((e.error,) if e.error else e.repairs))),
        quality=quality,
        report=next((path for path in reversed(reports) if path in there), ""),
    )
