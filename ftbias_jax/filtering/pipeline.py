"""The whole method over a whole log: ``init``, ``step`` and ``run``.

``scan_steps`` is the definition. ``run`` takes the fast route of ``fast/stages.py`` wherever that is exact, and is
tested equal to the definition.
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp

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
from ftbias_jax.types import Array, Sample

__all__ = [
    "DEFAULT_OPTIONS",
    "Emit",
    "Info",
    "Options",
    "State",
    "init",
    "keep_all",
    "keep_result",
    "options_from_setup",
    "predict_wrench",
    "run",
    "scan_steps",
    "step",
]


def keep_result(state: State, info: Info) -> dict[str, Array]:
    """What a result has of a sample: (n, 3), (n,), (2, 6) bias and drift, (6,) and (), in rad, N, Nm and per s."""
    std = partial(jnp.diagonal, axis1=-2, axis2=-1)
    return {
        "joint": state.joint.mean,
        "ddq_std": jnp.sqrt(std(state.joint.covariance)[:, 2]),
        "bias": state.bias.mean[:12].reshape(2, 6),
        "bias_std": jnp.sqrt(std(state.bias.covariance)[:12]).reshape(2, 6),
        "wrench_tool": info.wrench_tool,
        "innovation": info.wrench.value,
        "innovation_std": jnp.sqrt(std(info.wrench.covariance)),
        "nis": info.wrench.nis,
        "log_likelihood": info.log_likelihood,
    }


def keep_all(state: State, info: Info) -> tuple[State, Info]:
    """Everything of a sample, covariance matrices too: several times the memory, and the time."""
    return state, info


@partial(jax.jit, static_argnames=("options", "emit"))
def run(
    params: Params, state: State, samples: Sample, options: Options = DEFAULT_OPTIONS, emit: Emit = keep_result
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
        emit: what to keep of every sample, (state, info) -> pytree: by default what a result has. ``keep_all`` keeps
            the rest, too; what is not kept is not worked out.

    Returns:
        the last state, to carry into the next part of the log, and what ``emit`` kept, with a leading time axis.
    """
    if samples.dt.shape[0] == 0:
        return scan_steps(params, state, samples, options, emit)
    last, staged = stages.run(params, state, samples, options)
    return last, jax.vmap(emit)(*states_and_infos(params, state, samples, options, staged))


@partial(jax.jit, static_argnames=("options", "emit"))
def scan_steps(
    params: Params, state: State, samples: Sample, options: Options = DEFAULT_OPTIONS, emit: Emit = keep_result
) -> tuple[State, Any]:
    """The definition of filtering a log: ``lax.scan`` of ``step``, for any options; arguments as for ``run``."""

    def body(state: State, sample: Sample) -> tuple[State, Any]:
        state, info = step(params, state, sample, options)
        return state, emit(state, info)

    return jax.lax.scan(body, state, samples)
