"""``ftbias tune``: noise parameters of maximum likelihood from one log or many."""

from __future__ import annotations

import argparse
import sys
import time
from functools import partial
from typing import Any, NamedTuple

from ftbias_jax.cli.jobs.many import find_tasks, refuse_options, run_archive
from ftbias_jax.cli.repairs import tell_repairs, warn
from ftbias_jax.errors import LogError, UsageError
from ftbias_jax.fleet.entry import settings_of
from ftbias_jax.fleet.find import expand, inputs, is_folder
from ftbias_jax.io import read_log
from ftbias_jax.io.log import Log
from ftbias_jax.io.outputs import behind_link, check_outputs, output_of_setup
from ftbias_jax.io.write.ours import SETUP
from ftbias_jax.setup import Setup, load_setup


def run(arguments: argparse.Namespace) -> int:
    """Tune and write a setup; 1 if a fit did not converge, else 3 if logs or samples were left out.

    Of several processes, the first one speaks and writes.
    """
    tools = _tools(arguments)
    given = arguments.output or [None] * len(tools)
    if arguments.output and len(arguments.output) == 1 and is_folder(arguments.output[0]):
        return _each(arguments, tools)
    if len(given) != len(tools):
        message = f"{len(given)} outputs for {len(tools)} setups"
        raise UsageError(message, field="--output", remedy="give one -o for each --setup, in their order")
    places = [output_of_setup(output, path, arguments.in_place) for output, (path, _) in zip(given, tools, strict=True)]
    setups = [load_setup(path, with_tool=True, allow_outside=arguments.allow_outside) for path, _ in tools]
    kept = [name for _, names in places for name in names]
    tools = [(path, expand(logs, setup.log.files)) for setup, (path, logs) in zip(setups, tools, strict=True)]
    every_log = [log for _, logs in tools for log in logs]
    read = [file for setup, (_, logs) in zip(setups, tools, strict=True) for file in inputs(logs, setup.log.files)]
    options = [f"--output {number}" for number in range(1, len(tools) + 1)] if len(tools) > 1 else ["--output"]
    outputs = {option: place for option, (place, _) in zip(options, places, strict=True)}
    kinds = {} if arguments.in_place else dict.fromkeys(outputs, SETUP)
    check_outputs(outputs, (*read, *kept, *(setup.urdf for setup in setups)), kinds, arguments.force)

    import jax

    from ftbias_jax.calibration import distributed, newton
    from ftbias_jax.runtime.jax_config import prepare_jax

    apart = arguments.distributed is not None
    if apart:  # before anything asks JAX for its devices
        if len(tools) > 1:
            raise UsageError("is for one setup", field="--distributed", remedy="tune several tools by one process")
        distributed.start(*arguments.distributed)
    prepare_jax()
    from ftbias_jax.calibration.tune_setup import tune
    from ftbias_jax.cli.jobs.usable import read_usable, tell_left_out
    from ftbias_jax.model.own_effects import load_all

    if apart:
        shared = _read_share(setups[0], every_log, arguments.unchecked)
        every, start, left_out = [shared.logs], shared.start, shared.left_out
    else:
        found = [
            read_usable(setup, paths, "tune", arguments.unchecked)
            for setup, (_, paths) in zip(setups, tools, strict=True)
        ]
        for usable, (_, paths) in zip(found, tools, strict=True):
            tell_left_out(usable.errors, len(set(paths)))
        every = [usable.logs for usable in found]
        start, left_out = next(iter(every[0].values())), any(usable.errors for usable in found)
    speaks = jax.process_index() == 0
    code = tell_repairs((path, log.repairs) for logs in every for path, log in logs.items())
    logs = [list(logs.values()) for logs in every]
    tuned = tune(
        setups[0],
        logs[0],
        **_asked(arguments),
        others=list(zip(setups[1:], logs[1:], strict=True)),
        start=start,
        report=Reporter() if speaks else lambda label, iteration, value: None,
        total=distributed.total if apart else newton.alone,
        effects=load_all(tuple(arguments.own_effects)),
    )
    if speaks:
        print(tuned)
        if tuned.refusals and not arguments.force:
            print(f"ftbias: not written: {'; '.join(tuned.refusals)} (--force writes it)", file=sys.stderr)
            return 1
        for setup, (output, _) in zip((tuned.setup, *tuned.others), places, strict=True):
            setup.save(behind_link(output, arguments.in_place), by="" if arguments.in_place else "tune")
            print(f"wrote {output}")
        if not tuned.converged:
            warn("a fit did not converge; its values are the best so far")
    return (3 if left_out else code) if tuned.converged else 1


class Share(NamedTuple):
    """The logs of one of several processes."""

    logs: dict[str, Log]
    start: Log
    """The log that every process starts from."""
    left_out: bool
    """Whether any process had to leave out a log."""


def _read_share(setup: Setup, paths: list[str], unchecked: bool) -> Share:
    """The logs of this process, after all have agreed which can be used; all of them go on, or end.

    Raises:
        FtbiasError: too few logs are left, or they show the setup to be wrong.
    """
    import jax

    from ftbias_jax.calibration import distributed
    from ftbias_jax.cli.jobs.usable import mistaken, read_usable

    usable = read_usable(setup, distributed.share(paths), "tune", unchecked)
    for error in usable.errors.values():
        warn(f"left out: {error}")
    good = distributed.agree(paths, usable.logs)
    if len(good) < jax.process_count():
        message = f"{len(good)} of {len(paths)} logs can be used, by {jax.process_count()} processes"
        raise LogError(message, field="--distributed", remedy="start at most one process a log")
    mine = distributed.share(good)  # a process whose logs were bad gets others
    logs = {path: usable.logs[path] if path in usable.logs else read_log(path, setup) for path in mine}
    distributed.end_together(mistaken(setup, list(logs.values()), "tune", unchecked))
    start = logs[good[0]] if good[0] in logs else read_log(good[0], setup)
    return Share(logs, start, len(good) < len(paths))


def _each(arguments: argparse.Namespace, tools: list[tuple[str, list[str]]]) -> int:
    """To every log by itself, into a folder."""
    refuse_options(arguments, ("in_place", "distributed"))
    if len(tools) > 1:
        raise UsageError("a folder is for one setup", field="--output", remedy="give one --setup")
    path = tools[0][0]
    arguments.output, arguments.logs = arguments.output[0], [*arguments.logs, *arguments.setup[0][1:]]
    setup = load_setup(path, with_tool=True, allow_outside=arguments.allow_outside)
    tasks, manifest = find_tasks(arguments, setup, "tune", ".tuned.toml")

    from ftbias_jax.cli.jobs.work import tune_one

    asked, own = _asked(arguments), tuple(arguments.own_effects)
    settings = settings_of("tune", setup, {**asked, "force": arguments.force}, own)
    work = partial(tune_one, setup=setup, asked=asked, force=arguments.force, own=own)
    return run_archive(arguments, settings, tasks, manifest, work)


def _asked(arguments: argparse.Namespace) -> dict[str, Any]:
    """Named arguments of the verb ``tune``, plain numbers and words."""
    return {
        name: getattr(arguments, name) for name in ("fit", "tie", "data_noise", "restarts", "hold_out", "unchecked")
    }


def _tools(arguments: argparse.Namespace) -> list[tuple[str, list[str]]]:
    """Setups and their logs: those after --setup, or all logs if there is one setup."""
    tools = [(setup, logs) for setup, *logs in arguments.setup]
    if len(tools) == 1:
        tools = [(tools[0][0], [*arguments.logs, *tools[0][1]])]
    elif arguments.logs:
        message = f"{arguments.logs[0]!r} stands before the first of several --setup"
        raise UsageError(message, field="LOG", remedy="give each log after the setup of its tool")
    for setup, logs in tools:
        if not logs:
            raise UsageError(f"{setup!r} has no log", field="LOG", remedy="give at least one")
    return tools


class Reporter:
    """Tells of the iterations of each fit on standard error, sparsely where that is no terminal."""

    def __init__(self) -> None:
        self._label, self._start, self._last = "", time.monotonic(), time.monotonic()

    def __call__(self, label: str, iteration: int, value: float) -> None:
        """One iteration of a fit is done."""
        if label != self._label:  # a fit starts where the one before it ended
            self._label, self._start = label, self._last
        self._last = time.monotonic()
        elapsed, terminal = self._last - self._start, sys.stderr.isatty()
        if terminal or elapsed > 2:
            text = f"{label}: iteration {iteration}, {value:.2f} nats, {elapsed:.0f} s"
            print(text, end="\r" if terminal else "\n", file=sys.stderr, flush=True)
