"""What each command does with one log of many: from a file to a result and its quality.

A process runs one of them for many logs, so what is compiled for the first one serves the others.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ftbias_jax.check.check_setup import check_setup
from ftbias_jax.cli.jobs.each_log import Done
from ftbias_jax.cli.jobs.many import ANSWER, APPLIED, REPORT
from ftbias_jax.cli.jobs.one_file import Choices, filter_file
from ftbias_jax.errors import LogError
from ftbias_jax.fleet import quality
from ftbias_jax.fleet.entry import LOSS, MISTAKES, OK
from ftbias_jax.io import read_log, read_motion
from ftbias_jax.io.log import Log, Repairs
from ftbias_jax.io.parts import open_log
from ftbias_jax.io.write.provenance import Provenance, provenance, source_of
from ftbias_jax.model.own_effects import load_all
from ftbias_jax.setup.types import Setup


def filter_one(
    log: str, output: str, setup: Setup, choices: Choices, salvage: bool = False, own: tuple[str, ...] = ()
) -> Done:
    """Filter a log into a file.

    Args:
        log: path of the log.
        output: path of the result.
        setup: shared by all logs.
        choices: the command's options.
        salvage: read what a damaged file still holds.
        own: files of the user's own effects; every process runs their code itself, because code cannot be sent to it.
    """
    setup = setup.with_effects(load_all(own))
    outcome = filter_file(open_log(log, setup, salvage=salvage), setup, output, choices)
    remarks = (*outcome.warnings, *(repair.what for repair in outcome.repairs))
    found = quality.of_filter(outcome.summary, outcome.check, outcome.origin)
    return Done(LOSS if outcome.lost else OK, outcome.summary.samples, remarks, found)


def check_one(log: str, output: str, setup: Setup) -> Done:
    """Check a setup on a log, into a JSON file."""
    read = read_motion(log, setup)
    check = check_setup(setup, [read])
    check.to_json(output)
    status, remarks = _lost(read.repairs)
    if not check.ok:
        status, remarks = MISTAKES, (*map(str, check.findings), *remarks)
    origin = provenance(setup, [source_of(read, log)], {})
    return Done(status, origin["samples"], remarks, quality.of_check(check, origin))


def diagnose_one(
    log: str,
    output: str,
    setup: Setup,
    without: tuple[str, ...],
    unchecked: bool,
    apply: bool = False,
    own: tuple[str, ...] = (),
) -> Done:
    """Diagnose a log, into a JSON file, the report beside it, and if asked the setup with the causes.

    Args:
        log: its path.
        output: the JSON file.
        setup: of all logs.
        without: effects to leave out.
        unchecked: as of the command.
        apply: also write the setup with what was found, unless nothing of that can be stated.
        own: as for ``filter_one``.
    """
    from ftbias_jax.diagnosis.apply import refused, some_applied
    from ftbias_jax.diagnosis.diagnose import diagnose

    setup = setup.with_effects(load_all(own))
    read = read_log(log, setup, raw=True)
    diagnosis = diagnose(setup, [read], [Path(log).name], without=without, unchecked=unchecked)
    diagnosis = diagnosis._replace(command=shlex.join(("ftbias", "diagnose", log, "--setup", setup.path)))
    place = output.removesuffix(ANSWER)
    beside = [f"{place}{REPORT}"]
    diagnosis.to_html(beside[0])
    status, remarks = _lost(repair for repairs in diagnosis.repairs for repair in repairs)
    if apply:
        not_stated = refused(setup, diagnosis.causes, diagnosis.terms)
        if some_applied(diagnosis, not_stated):
            beside.append(f"{place}{APPLIED}")
            diagnosis.apply(setup).save(beside[-1], by="diagnose --apply")
        if not_stated:
            status, remarks = LOSS, (*(f"not applied: {why}" for why in not_stated), *remarks)
    diagnosis.to_json(output)
    samples = (diagnosis.provenance or {}).get("samples", 0)
    return Done(status, samples, remarks, quality.of_diagnosis(diagnosis), tuple(beside))


def identify_one(log: str, output: str, setup: Setup, asked: Mapping[str, Any]) -> Done:
    """Identify the tool from a log, into a setup.

    Args:
        log: its path.
        output: the setup that is written.
        setup: to start from.
        asked: ``mounting``, ``gravity``, ``bias``, ``crosstalk`` and ``unchecked`` of the command.
    """
    from ftbias_jax.calibration.identify_tool import identify_tool

    read = read_motion(log, setup)
    found = identify_tool(setup, read, **asked)
    found.save(output, by="identify")
    origin = _origin(setup, read) if isinstance(read, Log) else {}
    status, remarks = _lost(read.repairs)
    return Done(status, origin.get("samples", len(read.t)), remarks, quality.of_identified(found, origin))


def tune_one(
    log: str, output: str, setup: Setup, asked: Mapping[str, Any], force: bool, own: tuple[str, ...] = ()
) -> Done:
    """Tune the noise to a log, into a setup.

    Args:
        log: its path.
        output: the setup that is written.
        setup: to start from.
        asked: named arguments of ``tune``.
        force: write it even if it predicts unseen data worse.
        own: as for ``filter_one``.

    Raises:
        LogError: the result would be worse than the setup.
    """
    from ftbias_jax.calibration.tune_setup import tune

    read = read_log(log, setup)
    tuned = tune(setup, [read], effects=load_all(own), **asked)
    if tuned.refusals and not force:
        raise LogError(f"not written: {'; '.join(tuned.refusals)}", file=log, remedy="--force writes it")
    tuned.setup.save(output, by="tune")
    status, remarks = _lost(read.repairs)
    if not tuned.converged:
        status, remarks = LOSS, ("a fit did not converge; its values are the best so far", *remarks)
    origin = _origin(setup, read)
    return Done(status, origin["samples"], remarks, quality.of_tuned(tuned, origin))


def _origin(setup: Setup, log: Log) -> Provenance:
    return provenance(setup, [source_of(log)], {})


def _lost(repairs: Iterable[Any] | Repairs) -> tuple[str, tuple[str, ...]]:
    """Whether samples were lost, and what was mended or left out."""
    every = tuple(repairs)
    return LOSS if any(repair.lost for repair in every) else OK, tuple(repair.what for repair in every)
