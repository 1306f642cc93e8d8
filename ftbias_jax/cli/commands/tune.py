"""``ftbias tune``: noise parameters of maximum likelihood from one log or many."""

from __future__ import annotations

import argparse
import sys
import time

from ftbias_jax.cli.repairs import tell_repairs
from ftbias_jax.io import read_log
from ftbias_jax.io.outputs import check_outputs, output_of_setup
from ftbias_jax.setup import load_setup


def run(arguments: argparse.Namespace) -> int:
    """Tune and write a setup; 1 if a fit did not converge, else 3 if samples were lost.

    Of several processes, the first one speaks and writes.
    """
    output, kept = output_of_setup(arguments.output, arguments.setup, arguments.in_place)
    setup = load_setup(arguments.setup)
    check_outputs({"--output": output}, (*arguments.logs, *kept, setup.urdf))
    first = read_log(arguments.logs[0], setup)  # every process starts from its noise

    import jax

    from ftbias_jax.runtime.jax_config import prepare_jax

    prepare_jax()
    from ftbias_jax.calibration import distributed, newton
    from ftbias_jax.calibration.tune_setup import tune

    paths, total = arguments.logs, newton.alone
    if arguments.distributed is not None:
        distributed.start(*arguments.distributed)
        paths, total = distributed.share(paths), distributed.total
    speaks = jax.process_index() == 0
    logs = [first if path == arguments.logs[0] else read_log(path, setup) for path in paths]
    code = tell_repairs((path, log.repairs) for path, log in zip(paths, logs, strict=True))
    tuned = tune(
        setup,
        logs,
        fit=arguments.fit,
        tie=arguments.tie,
        restarts=arguments.restarts,
        hold_out=arguments.hold_out,
        start=first,
        report=Reporter() if speaks else lambda label, iteration, value: None,
        total=total,
    )
    if speaks:
        print(tuned)
        tuned.save(output)
        print(f"wrote {output}")
        if not tuned.converged:
            print("ftbias: a fit did not converge; its values are the best so far", file=sys.stderr)
    return code if tuned.converged else 1


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
