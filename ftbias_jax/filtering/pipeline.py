"""The whole method over a whole log: ``init``, ``step`` and ``run``.

``scan_steps`` is the definition. ``run`` takes the fast route of ``fast/stages.py`` wherever that is exact, and is
tested equal to the definition.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import jax

from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.fast.every_sample import states_and_infos
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
    "scan_steps",
    "step",
]


def keep_all(state: State, info: Info) -> tuple[State, Info]:
    """Keep everything of a sample."""
    return state, info


@partial(jax.jit, static_argnames=("options", "emit"))
def run(
    params: Params, state: State, samples: Sample, options: Options = DEFAULT_OPTIONS, emit: Emit = keep_all
) -> tuple[State, Any]:
    """Filter a whole log: equal to ``scan_steps`` to round-off, and over ten times faster.

    The fast route has a hand-written reverse pass. It reports a gradient of zero with respect to
    ``samples.dt``, does not support forward mode (``jax.jvp``, ``jax.jacfwd``), and ignores correlations between axes
    of the bias in the given state. Use ``scan_steps`` where that matters.

    Args:
        params: as for ``step``. Known effects need the fast route, and the whole log in one call if they have a memory.
        state: before the first sample: from ``init``, or carried from an earlier part of the log.
        samples: leaves with a leading time axis (T, ...).
        options: as for ``step``.
        emit: what to keep of every sample, (state, info) -> pytree; all of both by default. Keep little: what is not
            kept is not worked out.

    Returns:
        the last state, to carry into the next part of the log, and what ``emit`` kept, with a leading time axis.
    """
    if samples.dt.shape[0] == 0:
        by_steps: tuple[State, Any] = scan_steps(params, state, samples, options, emit)
        return by_steps
    last, staged = stages.run(params, state, samples, options)
    return last, jax.vmap(emit)(*states_and_infos(params, state, samples, options, staged))


@partial(jax.jit, static_argnames=("options", "emit"))
def scan_steps(
    params: Params, state: State, samples: Sample, options: Options = DEFAULT_OPTIONS, emit: Emit = keep_all
) -> tuple[State, Any]:
    """The definition of filtering a log: ``lax.scan`` of ``step``, for any options; arguments as for ``run``."""

    def body(state: State, sample: Sample) -> tuple[State, Any]:
        state, info = step(params, state, sample, options)
        return state, emit(state, info)

    return jax.lax.scan(body, state, samples)
