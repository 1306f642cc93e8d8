"""Programs of a search compiled while the logs are still being made ready for it.

They are traced in one order, whatever the processor's threads do, for their names in JAX's cache depend on it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

import jax
import numpy as np
from jax.stages import Lowered

from ftbias_jax.diagnosis.problem import bins_of
from ftbias_jax.diagnosis.regression.evaluate import lower_programs
from ftbias_jax.filtering.likelihood import WrenchProblem
from ftbias_jax.io.log import Log
from ftbias_jax.model.effects.types import Model, Signals, Values
from ftbias_jax.model.own_effects import catalogue_of_setup
from ftbias_jax.model.params import Params, params_from_setup
from ftbias_jax.runtime.jax_config import same_precision
from ftbias_jax.setup.types import Setup

WORKERS = 2
"""Programs that are compiled at a time, beside those of the smoother."""


@contextmanager
def compiled_ahead(setup: Setup, logs: Sequence[Log]) -> Iterator[None]:
    """While the block runs, compile the programs of a search on these logs; at its end, wait until that is done.

    Args:
        setup: beliefs.
        logs: as read.

    Raises:
        Exception: what XLA says of a program that it cannot compile, at the end of the block.
    """
    worker = ThreadPoolExecutor(WORKERS)
    try:
        compiling = [worker.submit(same_precision(lowered.compile)) for lowered in lower_search(setup, logs)]
        yield
        for one in compiling:
            one.result()
    finally:
        worker.shutdown(cancel_futures=True)


def lower_search(setup: Setup, logs: Sequence[Log]) -> Iterator[Lowered]:
    """The programs of a search on these logs, for each of their lengths, ready to be compiled.

    A log that loses bins while it is cleaned may turn out shorter; then its programs are compiled when they are called.
    """
    params = params_from_setup(setup)
    for bins, columns in dict.fromkeys((padded_bins(log), tuple(log.columns)) for log in logs):
        signals, wrench, known = outline(params, bins, columns)
        yield from lower_programs(signals, wrench, known, catalogue_of_setup(setup))


def outline(params: Params, bins: int, columns: Sequence[str] = ()) -> tuple[Signals, WrenchProblem, Values]:
    """What ``problem.make_problem`` will make of a log, with shapes in place of what is not known yet."""
    n, bias = params.joint.process_density.shape[0], params.bias

    def of(*shape: int) -> Any:
        return jax.ShapeDtypeStruct((bins, *shape), params.theta.dtype)

    model, seen = Model(params.arm, params.gravity, params.theta), {name: of() for name in columns}
    signals = Signals(of(), of(n), of(n), of(n), of(), model, columns=seen)
    wrench = WrenchProblem(of(), of(6), of(6), bias.density, bias.prior_std)
    return signals, wrench, params.effects or {}


def padded_bins(log: Log) -> int:
    """How many bins a log will have, if no sample turns out useless."""
    measured = np.isfinite(log.wrench).any(1)
    return bins_of(log.t[measured], float(log.t[-1]))[2]
