"""A log as the filters' input, and padding that makes logs of equal length."""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.io.log import Log
from ftbias_jax.model.effects.compose import fill_temperature
from ftbias_jax.types import Array, Sample


def samples_from_log(log: Log, dtype: Any = None, before: float | None = None) -> Sample:
    """A log as filter input: leaves with a leading time axis. dt is taken in float64 before any rounding to dtype.

    Args:
        log: a whole log, or a part of one.
        dtype: of the arrays.
        before: s, stamp of the sample before the part.
    """
    samples: Sample = jax.tree.map(jnp.asarray, arrays_from_log(log, dtype, before))
    return samples


def arrays_from_log(log: Log, dtype: Any = None, before: float | None = None) -> Sample:
    """The same as numpy arrays, which cost JAX nothing until a program takes them.

    Args:
        log: a whole log, or a part of one.
        dtype: of the arrays.
        before: s, stamp of the sample before the part.
    """
    dt = np.diff(np.asarray(log.t, np.float64), prepend=log.t[0] if before is None else before)
    temperature = fill_temperature(log.t, log.temperature) if np.isfinite(log.temperature).any() else None
    columns = {name: column.at(log.t) for name, column in log.columns.items()}
    rezeroed = np.asarray(log.is_rezeroed(log.t, before), float) if log.rezeroed_at else None
    arrays = Sample(dt, log.q, log.dq, log.wrench, temperature, columns or None, rezeroed)
    kind = jnp.result_type(float) if dtype is None else dtype
    samples: Sample = jax.tree.map(lambda x: np.asarray(x, kind), arrays)
    return samples


def first_position(q: Array) -> Array:
    """First finite position of every joint; (T, n) -> (n,) rad, NaN if there is none: ``first_measured`` in numpy."""
    q = np.asarray(q)
    found: Array = q[np.isfinite(q).argmax(0), np.arange(q.shape[1])]
    return found


def pad(samples: Sample, length: int) -> Sample:
    """Lengthen a log by samples that change nothing (dt = 0, all NaN), so that logs stack for vmap.

    Where it is of numpy arrays it stays so: of every other length JAX would compile a program of its own.
    """
    if samples.dt.shape[0] > length:
        raise ValueError(f"cannot pad {samples.dt.shape[0]} samples to {length}")
    return _pad(np, samples, length) if isinstance(samples.dt, np.ndarray) else _pad_by_jax(samples, length)


@partial(jax.jit, static_argnames="length")
def _pad_by_jax(samples: Sample, length: int) -> Sample:
    return _pad(jnp, samples, length)


def _pad(xp: Any, samples: Sample, length: int) -> Sample:
    missing = length - samples.dt.shape[0]

    def lengthen(x: Array, value: float) -> Array:
        return xp.concatenate([x, xp.full((missing, *x.shape[1:]), value, x.dtype)])

    q, dq, wrench = (lengthen(x, np.nan) for x in samples[1:4])
    temperature, columns = jax.tree.map(lambda x: xp.pad(x, (0, missing), mode="edge"), samples[4:6])
    rezeroed = None if samples.rezeroed is None else lengthen(samples.rezeroed, 0.0)
    return Sample(lengthen(samples.dt, 0.0), q, dq, wrench, temperature, columns, rezeroed)
