"""Programs of a search loaded or compiled while the logs are still being made ready for it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from typing import Any

import jax
import numpy as np

from ftbias_jax.diagnosis.regression import chain_model
from ftbias_jax.diagnosis.regression.coordinates import layout
from ftbias_jax.diagnosis.samples.bins import bins_of
from ftbias_jax.diagnosis.samples.smoothed import padded_samples, prepare_smoother
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.io.log import Log
from ftbias_jax.model.effects.types import Model, Signals, Values, motion_of
from ftbias_jax.model.kinematics.arm_batch import ArmMotion
from ftbias_jax.model.own_effects import catalogue_of_setup
from ftbias_jax.model.params import Params, params_from_setup
from ftbias_jax.runtime.jax_config import same_precision
from ftbias_jax.setup.types import Setup

WORKERS = 2
"""Programs that are compiled at a time, beside those of the smoother."""


@contextmanager
def compiled_ahead(setup: Setup, logs: Sequence[Log]) -> Iterator[None]:
    """While the block runs, compile the programs of a search on these logs; at its end, wait until that is done.

    If the block fails nobody waits: what is being compiled then is finished, and kept, behind the error. What XLA says
    of a program that it cannot compile is raised at the end of the block.
    """
    worker = ThreadPoolExecutor(WORKERS)
    try:
        compiling = [worker.submit(same_precision(prepare)) for prepare in programs_of_search(setup, logs)]
        yield
        for one in compiling:
            one.result()
    finally:
        worker.shutdown(wait=False, cancel_futures=True)


def programs_of_search(setup: Setup, logs: Sequence[Log]) -> Iterator[Callable[[], object]]:
    """Make the programs of a search on these logs ready, when called, and first that which smooths their joints.

    For each of their lengths. A log that loses bins while it is cleaned may turn out shorter; then its programs are
    compiled when they are called.
    """
    params, options = params_from_setup(setup), Options(joint_model=setup.joints.model)
    outlines = (jax.tree.map(_outline, padded_samples(log)) for log in logs)
    for samples in {str(outline): outline for outline in outlines}.values():
        yield partial(prepare_smoother, params, samples, options)
    catalogue = catalogue_of_setup(setup)
    for bins, columns in dict.fromkeys((padded_bins(log), tuple(log.columns)) for log in logs):
        signals, known, moving = outline(params, bins, columns)
        z = jax.ShapeDtypeStruct((layout(signals.q.shape[1], catalogue).size,), signals.q.dtype)
        # The longest first.
        yield partial(chain_model.reading.prepare, signals, known, moving, z, catalogue=catalogue)
        yield partial(chain_model.motion.prepare, signals, known, z, catalogue=catalogue)
        yield partial(chain_model.to_values.prepare, signals, z, catalogue=catalogue)


def _outline(x: np.ndarray) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(x.shape, x.dtype)


def outline(params: Params, bins: int, columns: Sequence[str] = ()) -> tuple[Signals, Values, ArmMotion]:
    """What ``problem.make_problem`` will make of a log, with shapes in place of what is not known yet."""
    n = params.joint.process_density.shape[0]

    def of(*shape: int) -> Any:
        return jax.ShapeDtypeStruct((bins, *shape), params.theta.dtype)

    model, seen = Model(params.arm, params.gravity, params.theta), {name: of() for name in columns}
    signals = Signals(of(), of(n), of(n), of(n), of(), model, columns=seen)
    return signals, params.effects or {}, jax.eval_shape(motion_of, signals)


def padded_bins(log: Log) -> int:
    """How many bins a log will have, if no sample turns out useless."""
    measured = np.isfinite(log.wrench).any(1)
    return bins_of(log.t[measured], float(log.t[-1]))[2]
