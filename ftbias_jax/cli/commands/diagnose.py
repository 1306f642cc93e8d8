"""``ftbias diagnose``: where logs depart from the model, which effects cause it, and how far the gap shrinks."""

import argparse
import os
import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ftbias_jax.cli.archive import Done, for_each_log
from ftbias_jax.cli.given import logs_of, save_setup, setup_of, start_jax, write_answers
from ftbias_jax.cli.terminal import print_repairs
from ftbias_jax.errors import LogError, UsageError
from ftbias_jax.fleet.entry import LOSS
from ftbias_jax.fleet.find import is_folder
from ftbias_jax.fleet.quality import of_diagnosis
from ftbias_jax.io import read_log
from ftbias_jax.io.log import Log, Repair, Repairs
from ftbias_jax.io.remote import is_url
from ftbias_jax.io.write.outputs import DIAGNOSIS, PAGE, SETUP, output_of_setup
from ftbias_jax.io.write.provenance import FIRST_DATE, LAST_DATE
from ftbias_jax.runtime.imports import many_imports
from ftbias_jax.runtime.progress import Stages
from ftbias_jax.setup import Setup

FEW = 3
"""Maximum number of logs whose names are shown while they are diagnosed."""
ANSWER, REPORT, APPLIED = ".diagnosis.json", ".diagnosis.html", ".applied.toml"
"""Suffixes of the files written for one log of an archive, appended to its path without suffix."""


def run(arguments: argparse.Namespace) -> int:
    """Diagnose the logs; returns 1 if a cause cannot or should not be applied, 3 if samples were lost, else 0."""
    if arguments.output and is_folder(arguments.output) and not arguments.pool:
        return _each(arguments)
    _check_apply(arguments)
    setup = setup_of(arguments)
    paths = logs_of(arguments, setup, {"--output": SETUP, "--json": DIAGNOSIS, "--html": PAGE})
    names = [Path(path).name for path in paths]
    if arguments.against and len(arguments.against) != len(paths):
        message = f"{len(arguments.against)} files for {len(paths)} logs"
        raise UsageError(message, field="--against", remedy="give one for each log, in their order")
    with Stages(f"diagnosing {', '.join(names) if len(names) <= FEW else f'{len(names)} logs'}") as stages:
        stages("reading")
        paths, logs, left_out = _read_all(paths, setup, tolerant=bool(arguments.pool))
        names = [Path(path).name for path in paths]
        with many_imports():
            start_jax()
            from ftbias_jax.commissioning.events import without_events
            from ftbias_jax.commissioning.judged import objection
            from ftbias_jax.diagnosis.apply import is_left_to_bias, refused, some_applied
            from ftbias_jax.diagnosis.diagnose import diagnose

        setup = _with_effects(arguments, setup)
        if arguments.against:
            from ftbias_jax.simulators.replay import read_against

            pairs = zip(arguments.against, logs, strict=True)
            logs = [read_against(path, setup, log) for path, log in pairs]
        else:
            logs = [_against_columns(setup, log) for log in logs]
        without, unchecked = tuple(arguments.without), arguments.unchecked
        asked = {"without": without, "unchecked": unchecked, "progress": stages}
        if arguments.pool:
            from ftbias_jax.diagnosis.pooled import diagnose_pooled

            dates = list(map(date_of, paths, logs))
            order = sorted(range(len(paths)), key=dates.__getitem__)
            names, paths, logs = [names[i] for i in order], [paths[i] for i in order], [logs[i] for i in order]
            diagnosis = diagnose_pooled(setup, logs, sorted(dates), names, **asked)
        else:
            diagnosis = diagnose(setup, logs, names, **asked)
    diagnosis = diagnosis._replace(command=_command(paths, arguments.setup, arguments.pool))
    latest = slice(-len(diagnosis.logs), None)  # the diagnosed logs: the latest if pooled, else all
    print(diagnosis)
    not_stated = refused(setup, diagnosis.causes, diagnosis.terms) if arguments.apply else ()
    applied = arguments.apply and some_applied(diagnosis, not_stated)
    if applied and not arguments.force and (against := objection(setup, diagnosis, logs[latest])):
        not_stated, applied = (*not_stated, f"{against}; --force writes it all the same"), False
    fixed, output = (diagnosis.apply(setup), arguments.output) if applied else (setup, None)
    write_answers(
        {
            arguments.json: diagnosis.to_json,
            arguments.html: diagnosis.to_html,
            output: lambda path: save_setup(fixed.save, path, arguments, "diagnose --apply"),
        }
    )
    if events := without_events(fixed, setup)[1]:
        only = "has times of these logs, so that this setup fits no others (ftbias calibrate leaves them out)"
        print(f"ftbias: {arguments.output}: {', '.join(events)} {only}", file=sys.stderr)
    if output and any(map(is_left_to_bias, diagnosis.terms)):
        why = "what changes slowly with the time of a log is no property of the robot, and the filter's bias follows it"
        print(f"ftbias: not applied: {why}", file=sys.stderr)
    for why in not_stated:
        print(f"ftbias: not applied: {why}", file=sys.stderr)
    code = print_repairs([*left_out, *zip(paths[latest], diagnosis.repairs, strict=True)])
    return 1 if not_stated else code


def _read_all(
    paths: list[str], setup: Setup, *, tolerant: bool
) -> tuple[list[str], list[Log], list[tuple[str, Repairs]]]:
    """Logs as recorded with their paths, and paths of those that cannot be read, if ``tolerant`` and some can."""
    read, left_out = dict[str, Log](), list[tuple[str, Repairs]]()
    for place, path in enumerate(paths, 1):
        try:
            read[path] = read_log(path, setup, raw=True)
        except LogError as error:
            if not tolerant or (place == len(paths) and not read):
                raise
            left_out.append((path, (Repair(f"left out: {str(error).removeprefix(f'{path}: ')}", True),)))
    return list(read), list(read.values()), left_out


def date_of(path: str, log: Log) -> float:
    """Start of a log by its own stamps, or else the last modification of its file, s since 1970."""
    return log.start if FIRST_DATE < log.start < LAST_DATE or is_url(path) else os.path.getmtime(path)


def _against_columns(setup: Setup, log: Log) -> Log:
    """Log prepared for diagnosis against a simulator if its columns hold a simulated wrench, else the log unchanged."""
    if not log.columns:
        return log
    from ftbias_jax.simulators.replay import against_columns

    return against_columns(setup, log)


def _command(paths: list[str], setup: str, pool: str | None = None) -> str:
    """Command line that reproduces a diagnosis."""
    return shlex.join(("ftbias", "diagnose", *paths, "--setup", setup, *(("--pool", pool) if pool else ())))


def _with_effects(arguments: argparse.Namespace, setup: Setup) -> Setup:
    """Setup with the user's own effects, after a check that the effects to leave out exist."""
    from ftbias_jax.model.effects.catalogue import check_names
    from ftbias_jax.model.effects.terms.parse import TERM
    from ftbias_jax.model.own_effects import catalogue_of_setup, load_all

    setup = setup.with_effects(load_all(tuple(arguments.own_effects)))
    check_names({*arguments.without} - {TERM}, "--without", catalogue_of_setup(setup))
    return setup


def _check_apply(arguments: argparse.Namespace) -> None:
    """Check that --apply, --output and --in-place are consistent, and set the output path.

    Raises:
        UsageError: --apply without --output, or the other way round.
    """
    if not arguments.apply:
        if arguments.output:
            remedy = "add --apply; the diagnosis itself is written by --json OUT.json and --html OUT.html"
            raise UsageError("is the setup that --apply writes", field="--output", remedy=remedy)
        if arguments.in_place:
            raise UsageError("replaces the setup by what --apply writes", field="--in-place", remedy="add --apply")
    elif not arguments.output and not arguments.in_place:
        remedy = "add -o FIXED.toml, or --in-place to replace the setup itself"
        raise UsageError("needs the name of the setup to write", field="--apply", remedy=remedy)
    else:
        arguments.output = output_of_setup(arguments.output, arguments.setup, arguments.in_place)


def _each(arguments: argparse.Namespace) -> int:
    """Diagnose every log separately into a folder."""
    setup = setup_of(arguments)
    _with_effects(arguments, setup)
    asked = {"without": sorted(arguments.without), "unchecked": arguments.unchecked}
    asked |= {"apply": True} if arguments.apply else {}
    beside = (REPORT, APPLIED) if arguments.apply else (REPORT,)
    single = ("json", "html", "in_place", "against")
    return for_each_log(arguments, setup, diagnose_one, asked, ANSWER, single=single, beside=beside)


def diagnose_one(path: str, output: str, setup: Setup, asked: Mapping[str, Any]) -> Done:
    """Diagnose one log of an archive; write its diagnosis, its report and, if asked, the setup with its causes."""
    from ftbias_jax.commissioning.judged import objection
    from ftbias_jax.diagnosis.apply import refused, some_applied
    from ftbias_jax.diagnosis.diagnose import diagnose

    log = _against_columns(setup, read_log(path, setup, raw=True))
    without, unchecked = tuple(asked["without"]), asked["unchecked"]
    diagnosis = diagnose(setup, [log], [Path(path).name], without=without, unchecked=unchecked)
    diagnosis = diagnosis._replace(command=_command([path], setup.path))
    place = output.removesuffix(ANSWER)
    beside = [f"{place}{REPORT}"]
    diagnosis.to_html(beside[0])
    not_stated: tuple[str, ...] = ()
    if asked.get("apply"):
        not_stated = tuple(refused(setup, diagnosis.causes, diagnosis.terms))
        applied = some_applied(diagnosis, not_stated)
        if applied and (against := objection(setup, diagnosis, [log])):
            not_stated = (*not_stated, against)
        elif applied:
            beside.append(f"{place}{APPLIED}")
            diagnosis.apply(setup).save(beside[-1], by="diagnose --apply")
    diagnosis.to_json(output)
    repairs = tuple(repair for repairs in diagnosis.repairs for repair in repairs)
    samples = (diagnosis.provenance or {}).get("samples", 0)
    done = Done.of(repairs, samples, of_diagnosis(diagnosis))._replace(beside=tuple(beside))
    if not not_stated:
        return done
    return done._replace(status=LOSS, remarks=(*(f"not applied: {why}" for why in not_stated), *done.remarks))
