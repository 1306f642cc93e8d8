"""The result of filtering a log, and what it needs of every sample."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ftbias_jax.filtering.fast.stages import Staged
from ftbias_jax.filtering.pipeline import Info, State
from ftbias_jax.types import Array


class Filtered(NamedTuple):
    """Result of filtering a log, at the stamps where any wrench axis was measured. Signs as in the report.

    numpy arrays with leading axis T; the fields are those of the output file, with the same names. Effects that the
    setup knows of are in wrench_tool, those of the bias (warming up, temperature) in bias.
    """

    t: Array
    bias: Array
    drift: Array
    bias_std: Array
    drift_std: Array
    wrench_unbiased: Array
    q: Array
    dq: Array
    ddq: Array
    ddq_std: Array
    wrench_tool: Array
    innovation: Array
    nis: Array
    log_likelihood: Array
    innovation_std: Array


def join(parts: Sequence[Filtered]) -> Filtered:
    """The results of consecutive parts as one."""
    whole = Filtered(*(x[0] if x[0].ndim == 0 else np.concatenate(x) for x in zip(*parts, strict=True)))
    return whole._replace(log_likelihood=np.sum([part.log_likelihood for part in parts]))


def keep(state: State, info: Info) -> dict[str, Array]:
    """What the output needs of one step: arrays (n, 3), (2, 6) and (6,) in the units of ``Filtered``, rad, N, Nm."""
    std = partial(jnp.diagonal, axis1=-2, axis2=-1)
    return {
        "joint": state.joint.mean,
        "ddq_std": jnp.sqrt(std(state.joint.covariance)[:, 2]),
        "bias": state.bias.mean.reshape(2, 6),
        "bias_std": jnp.sqrt(std(state.bias.covariance)).reshape(2, 6),
        "wrench_tool": info.wrench_tool,
        "innovation": info.wrench.value,
        "innovation_std": jnp.sqrt(std(info.wrench.covariance)),
        "nis": info.wrench.nis,
        "log_likelihood": info.log_likelihood,
    }


def keep_staged(track: Staged, wrench: Array) -> dict[str, Array]:
    """The same of a staged run with wrench (T, 6) N, Nm; it reports an innovation of 0 where nothing was measured."""
    variances = [jnp.diagonal(track.covariance, axis1=1, axis2=2) for track in (track.joint, track.wrench)]
    return {
        "joint": jnp.swapaxes(track.joint.mean, 1, 2),
        "ddq_std": jnp.sqrt(variances[0][:, :, 2]),
        "bias": track.wrench.mean,
        "bias_std": jnp.sqrt(jnp.swapaxes(variances[1], 1, 2)),
        "wrench_tool": track.wrench_tool,
        "innovation": jnp.where(jnp.isfinite(wrench), track.wrench.innovation[:, 0], jnp.nan),
        "innovation_std": jnp.sqrt(track.wrench.innovation_variance[:, 0]),
        "nis": track.wrench.nis.sum(1),
        "log_likelihood": track.joint.log_likelihood.sum(1) + track.wrench.log_likelihood.sum(1),
    }
