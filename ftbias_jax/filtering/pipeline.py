"""The whole method over a whole log: ``init``, ``step`` and ``run``."""

from __future__ import annotations

from functools import partial
from typing import Any

import jax

from ftbias_jax.filtering.step import (
    DEFAULT_OPTIONS,
    Emit,
    Info,
    Options,
    State,
    init,
    options_from_setup,
    predict_wrench,
    step,
)
from ftbias_jax.model.params import Params
from ftbias_jax.types import Sample

__all__ = [
    "DEFAULT_OPTIONS",
    "Emit",
    "Info",
    "Options",
    "State",
    "init",
    "options_from_setup",
    "predict_wrench",
    "run",
    "step",
]


@partial(jax.jit, static_argnames=("options", "emit"))
def run(
    params: Params,
    state: State,
    samples: Sample,
    options: Options = DEFAULT_OPTIONS,
    emit: Emit = lambda state, info: (state, info),
) -> tuple[State, Any]:
    """Filter a whole log: ``lax.scan`` of ``step``.

    Args:
        params: as for ``step``.
        state: as for ``step``.
        options: as for ``step``.
        samples: leaves with a leading time axis (T, ...).
        emit: what to keep of every sample, (state, info) -> pytree; all of both by default.

    Returns:
        the last state, to carry into the next part of the log, and what ``emit`` kept, with a leading time axis.
    """

    def body(state: State, sample: Sample) -> tuple[State, Any]:
        state, info = step(params, state, sample, options)
        return state, emit(state, info)

    return jax.lax.scan(body, state, samples)
