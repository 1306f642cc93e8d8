"""``ftbias tune``: fit the noise parameters to one or more logs by maximum likelihood."""

import argparse
import io
import sys
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ftbias_jax.check.check_setup import require_right
from ftbias_jax.cli.archive import Done, for_each_log
from ftbias_jax.cli.given import save_setup
from ftbias_jax.cli.terminal import print_repairs, warn
from ftbias_jax.errors import FtbiasError, LogError, SetupError, UsageError
from ftbias_jax.fleet.entry import LOSS
from ftbias_jax.fleet.find import expand, inputs, is_folder
from ftbias_jax.fleet.quality import of_tuned
from ftbias_jax.io import read_log
from ftbias_jax.io.log import Log
from ftbias_jax.io.write.outputs import SETUP, check_outputs, output_of_setup
from ftbias_jax.io.write.provenance import provenance, source_of
from ftbias_jax.runtime.progress import Stages
from ftbias_jax.setup import Setup, load_setup

NOT_CONVERGED = "a fit did not converge; its values are the best so far"


class Used(NamedTuple):
    """Logs of one tool to which the noise is fitted, and those that are left out."""

    logs: dict[str, Log]
    """Path -> log."""
    errors: Mapping[str, FtbiasError]
    """Path -> reason why the log cannot be used."""


def run(arguments: argparse.Namespace) -> int:
    """Tune and write a setup; returns 1 if a fit did not converge or is refused, 3 if data were left out, else 0.

    Of several processes, only the first one prints and writes.
    """
    tools = _tools(arguments)
    asked = {
        name: getattr(arguments, name) for name in ("fit", "tie", "data_noise", "restarts", "hold_out", "unchecked")
    }
    given = arguments.output or [None] * len(tools)
    if arguments.output and len(given) == 1 and is_folder(given[0]):
        if len(tools) > 1:
            raise UsageError("a folder is for one setup", field="--output", remedy="give one --setup")
        (path, arguments.logs), arguments.output = tools[0], given[0]
        setup = load_setup(path, with_tool=True, allow_outside=arguments.allow_outside)
        asked |= {"force": arguments.force}
        return for_each_log(arguments, setup, tune_one, asked, ".tuned.toml", single=("in_place", "distributed"))
    if len(given) != len(tools):
        message = f"{len(given)} outputs for {len(tools)} setups"
        raise UsageError(message, field="--output", remedy="give one -o for each --setup, in their order")
    outputs = [
        output_of_setup(output, path, arguments.in_place) for output, (path, _) in zip(given, tools, strict=True)
    ]
    setups = [load_setup(path, with_tool=True, allow_outside=arguments.allow_outside) for path, _ in tools]
    paths = [expand(logs, setup.log.files) for setup, (_, logs) in zip(setups, tools, strict=True)]
    numbers = range(1, len(tools) + 1) if len(tools) > 1 else [""]
    named = {f"--output {number}".strip(): output for number, output in zip(numbers, outputs, strict=True)}
    stated = [file for setup in setups for file in (setup.files if not arguments.in_place else (setup.description,))]
    read = [file for setup, logs in zip(setups, paths, strict=True) for file in inputs(logs, setup.log.files)]
    check_outputs(named, (*read, *stated), {} if arguments.in_place else dict.fromkeys(named, SETUP), arguments.force)

    import jax

    from ftbias_jax.calibration import distributed, newton
    from ftbias_jax.runtime.jax_config import prepare_jax

    apart = arguments.distributed is not None
    if apart:  # must precede every query of JAX's devices
        if len(tools) > 1:
            raise UsageError("is for one setup", field="--distributed", remedy="tune several tools by one process")
        place = arguments.distributed
        distributed.start(*(place if isinstance(place, tuple) else ()))  # a launcher supplies what is not given
    prepare_jax()
    from ftbias_jax.calibration.tune_setup import tune
    from ftbias_jax.model.own_effects import load_all

    if apart:
        share, start = _share(setups[0], paths[0], arguments.unchecked)
        used = [share]
    else:
        used = [usable(setup, logs, arguments.unchecked) for setup, logs in zip(setups, paths, strict=True)]
        for found in used:
            if not found.logs:
                raise next(iter(found.errors.values()))
            _print_left_out(found.errors)
        start = next(iter(used[0].logs.values()))
    speaks = jax.process_index() == 0
    code = print_repairs((path, log.repairs) for found in used for path, log in found.logs.items())
    logs = [list(found.logs.values()) for found in used]
    with Stages("tuning", sys.stderr if speaks else io.StringIO()) as stages:
        stages("getting ready")
        tuned = tune(
            setups[0],
            logs[0],
            **asked,
            others=list(zip(setups[1:], logs[1:], strict=True)),
            start=start,
            report=lambda label, iteration, value: stages(f"{label}: iteration {iteration}, {value:.2f} nats"),
            total=distributed.total if apart else newton.alone,
            effects=load_all(tuple(arguments.own_effects)),
        )
    if speaks:
        print(tuned)
        if tuned.refusals and not arguments.force:
            print(f"ftbias: not written: {'; '.join(tuned.refusals)} (--force writes it)", file=sys.stderr)
            return 1
        for setup, output in zip((tuned.setup, *tuned.others), outputs, strict=True):
            save_setup(setup.save, output, arguments, "tune")
            print(f"wrote {output}")
        if not tuned.converged:
            warn(NOT_CONVERGED)
    if not tuned.converged:
        return 1
    return 3 if any(found.errors for found in used) else code


def tune_one(path: str, output: str, setup: Setup, asked: Mapping[str, Any]) -> Done:
    """Fit the noise to one log of an archive.

    Raises:
        LogError: the result predicts held-out data worse than the setup, and ``force`` is not set.
    """
    from ftbias_jax.calibration.tune_setup import tune

    log = read_log(path, setup)
    tuned = tune(setup, [log], **{name: value for name, value in asked.items() if name != "force"})
    if tuned.refusals and not asked["force"]:
        raise LogError(f"not written: {'; '.join(tuned.refusals)}", file=path, remedy="--force writes it")
    tuned.setup.save(output, by="tune")
    origin = provenance(setup, [source_of(log)], {})
    done = Done.of(log.repairs, origin["samples"], of_tuned(tuned, origin))
    return done if tuned.converged else done._replace(status=LOSS, remarks=(NOT_CONVERGED, *done.remarks))


def usable(setup: Setup, paths: Sequence[str], unchecked: bool) -> Used:
    """Read logs; leave out those that cannot be read, and those that contradict the setup unless all of them do.

    Args:
        setup: setup of all logs.
        paths: paths of the logs.
        unchecked: skip the check of the setup against the logs.
    """
    logs: dict[str, Log] = {}
    errors: dict[str, FtbiasError] = {}
    for path in paths:
        try:
            logs[path] = read_log(path, setup)
        except LogError as error:
            errors[path] = error
    found = {path: _mistaken(setup, [log], unchecked) for path, log in logs.items()}
    wrong = {path: error for path, error in found.items() if error is not None}
    if len(wrong) < len(logs):  # otherwise it is the setup that is wrong, not the logs
        logs = {path: log for path, log in logs.items() if path not in wrong}
        errors |= {path: LogError(str(error), file=path) for path, error in wrong.items()}
    return Used(logs, errors)


def _mistaken(setup: Setup, logs: Sequence[Log], unchecked: bool) -> FtbiasError | None:
    """Error raised by the check of a setup against logs; None if it passes."""
    try:
        if logs:
            require_right(setup, logs, "tune", unchecked)
    except (SetupError, LogError) as error:
        return error
    return None


def _print_left_out(errors: Mapping[str, FtbiasError]) -> None:
    for error in errors.values():
        warn(f"left out: {error}")


def _share(setup: Setup, paths: list[str], unchecked: bool) -> tuple[Used, Log]:
    """Logs of this process, once all agree which logs are usable, and the log that the joint noise starts from.

    Raises:
        FtbiasError: too few logs are left, or they contradict the setup; then all processes end.
    """
    import jax

    from ftbias_jax.calibration import distributed

    found = usable(setup, distributed.share(paths), unchecked)
    _print_left_out(found.errors)
    good = distributed.agree(paths, found.logs)
    if len(good) < jax.process_count():
        message = f"{len(good)} of {len(paths)} logs can be used, by {jax.process_count()} processes"
        raise LogError(message, field="--distributed", remedy="start at most one process a log")
    mine = distributed.share(good)  # a process whose logs were bad gets others
    logs = {path: found.logs[path] if path in found.logs else read_log(path, setup) for path in mine}
    distributed.end_together(_mistaken(setup, list(logs.values()), unchecked))
    start = logs[good[0]] if good[0] in logs else read_log(good[0], setup)
    return Used(logs, dict.fromkeys(set(paths) - set(good), LogError("cannot be used"))), start


def _tools(arguments: argparse.Namespace) -> list[tuple[str, list[str]]]:
    """Setups with their logs: those that follow each --setup, or all logs if there is a single setup."""
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
