"""``ftbias tune``: noise parameters of maximum likelihood from one log or many."""

from __future__ import annotations

import argparse
import sys
import time

from ftbias_jax.cli.repairs import tell_repairs
from ftbias_jax.errors import UsageError
from ftbias_jax.io import read_log
from ftbias_jax.io.outputs import check_outputs, output_of_setup
from ftbias_jax.setup import load_setup


def run(arguments: argparse.Namespace) -> int:
    """Tune and write a setup; 1 if a fit did not converge, else 3 if samples were lost.

    Of several processes, the first one speaks and writes.
    """
    tools = _tools(arguments)
    given = arguments.output or [None] * len(tools)
    if len(given) != len(tools):
        message = f"{len(given)} outputs for {len(tools)} setups"
        raise UsageError(message, field="--output", remedy="give one -o for each --setup, in their order")
    places = [output_of_setup(output, path, arguments.in_place) for output, (path, _) in zip(given, tools, strict=True)]
    setups = [load_setup(path, with_tool=True) for path, _ in tools]
    kept = [name for _, names in places for name in names]
    inputs = [log for _, logs in tools for log in logs]
    options = [f"--output {number}" for number in range(1, len(tools) + 1)] if len(tools) > 1 else ["--output"]
    outputs = {option: place for option, (place, _) in zip(options, places, strict=True)}
    check_outputs(outputs, (*inputs, *kept, *(setup.urdf for setup in setups)))
    first = read_log(inputs[0], setups[0])  # every process starts from its noise

    import jax

    from ftbias_jax.runtime.jax_config import prepare_jax

    prepare_jax()
    from ftbias_jax.calibration import distributed, newton
    from ftbias_jax.calibration.tune_setup import tune
    from ftbias_jax.model.own_effects import load_all

    total = newton.alone
    if arguments.distributed is not None:
        distributed.start(*arguments.distributed)
        tools = [(path, distributed.share(logs)) for path, logs in tools]
        total = distributed.total
    speaks = jax.process_index() == 0
    logs = [
        [first if path == inputs[0] and setup is setups[0] else read_log(path, setup) for path in paths]
        for setup, (_, paths) in zip(setups, tools, strict=True)
    ]
    every_path = [path for _, paths in tools for path in paths]
    every_log = [log for some in logs for log in some]
    code = tell_repairs((path, log.repairs) for path, log in zip(every_path, every_log, strict=True))
    tuned = tune(
        setups[0],
        logs[0],
        fit=arguments.fit,
        tie=arguments.tie,
        data_noise=arguments.data_noise,
        others=list(zip(setups[1:], logs[1:], strict=True)),
        restarts=arguments.restarts,
        hold_out=arguments.hold_out,
        start=first,
        report=Reporter() if speaks else lambda label, iteration, value: None,
        total=total,
        unchecked=arguments.unchecked,
        effects=load_all(tuple(arguments.own_effects)),
    )
    if speaks:
        print(tuned)
        if tuned.reasons and not arguments.force:
            print(f"ftbias: not written: {'; '.join(tuned.reasons)} (--force writes it)", file=sys.stderr)
            return 1
        for setup, (output, _) in zip((tuned.setup, *tuned.others), places, strict=True):
            setup.save(output)
            print(f"wrote {output}")
        if not tuned.converged:
            print("ftbias: a fit did not converge; its values are the best so far", file=sys.stderr)
    return code if tuned.converged else 1


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
