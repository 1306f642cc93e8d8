"""A log as the filters' input, and padding to a common length."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.io.log import Log
from ftbias_jax.io.stamps.clock import LONG_PAUSE
from ftbias_jax.model.effects.compose import fill_temperature, forgetting_time
from ftbias_jax.model.effects.types import Effect, Values
from ftbias_jax.model.params import Params
from ftbias_jax.types import Array, Sample

FORGOTTEN = 0.003
"""Share of an effect's initial state below which the rest no longer matters."""
LONGEST, MOST = 3.0, 0.1
"""s, and share of the log, that are left out at most: a longer memory resembles a bias or oscillates about zero."""


def samples_from_log(log: Log, dtype: Any = None) -> Sample:
    """A log as filter input: leaves with a leading time axis. dt is taken in float64 before any rounding to dtype.

    Args:
        log: a whole log.
        dtype: of the arrays; None = JAX's default float.
    """
    return jax.tree.map(jnp.asarray, arrays_from_log(log, dtype))


def arrays_from_log(log: Log, dtype: Any = None, before: float | None = None) -> Sample:
    """A log as filter input in NumPy arrays, which cost JAX nothing until a program takes them.

    For a part of a log, ``before`` is the stamp, s, of the previous sample.
    """
    dt = np.diff(np.asarray(log.t, np.float64), prepend=log.t[0] if before is None else before)
    dt = np.minimum(dt, LONG_PAUSE)  # by then the bias is as uncertain as before the log; its variance must stay finite
    temperature = fill_temperature(log.t, log.temperature) if np.isfinite(log.temperature).any() else None
    columns = {name: column.at(log.t) for name, column in log.columns.items()}
    rezeroed = np.asarray(log.is_rezeroed(log.t, before), float) if log.rezeroed_at else None
    arrays = Sample(dt, log.q, log.dq, log.wrench, temperature, columns or None, rezeroed)
    kind = jnp.result_type(float) if dtype is None else dtype
    return jax.tree.map(lambda x: np.asarray(x, kind), arrays)


def settled_at(t: Array, params: Params) -> float:
    """Log time, s, at which the known effects have forgotten their initial state; the first stamp if none has memory.

    The stamps t (T,) s are those of the whole log.
    """
    return float(t[0] + waiting(params.effects or {}, float(t[-1] - t[0])))


def waiting(effects: Values, duration: float, catalogue: Mapping[str, Effect] | None = None) -> float:
    """Time, s, from the start of a log of this duration until effects forget their initial state; 0 if none has memory.

    A swinging mass, a tool on springs or a low-pass filter in the sensor is taken as settled at the first sample. If
    the arm moves there, the remaining transient offsets the readings and would be taken for bias.
    """
    return min(-np.log(FORGOTTEN) * forgetting_time(effects, catalogue), LONGEST, MOST * duration)


def without_unsettled(samples: Sample, t: Array, params: Params) -> Sample:
    """Samples of a whole log (effects need it whole) at t (T,) s, without the wrench before the effects settle."""
    unsettled = np.asarray(t) < settled_at(t, params)
    return samples._replace(wrench=np.where(unsettled[:, None], np.nan, samples.wrench)) if unsettled.any() else samples


def samples_of(params: Params, log: Log) -> Sample:
    """A whole log as the method's input, padded so that logs of similar length share a program; NumPy arrays."""
    samples = without_unsettled(arrays_from_log(log, params.theta.dtype), log.t, params)
    samples = samples if params.effects is not None else samples._replace(temperature=None, columns=None)
    return pad(samples, room_for(len(log.t)))


def room_for(length: int, least: int = 512) -> int:
    """Rows of the smallest program that takes this many samples: by default 512, 768, 1024, 1536 and so on."""
    half = 1 << max(0, (length - 1).bit_length() - 1)
    return max(least, half + half // 2 if length <= half + half // 2 else 2 * half)


def first_position(q: Array) -> Array:
    """First finite position of every joint; (T, n) -> (n,) rad, NaN if there is none: ``first_measured`` in NumPy."""
    q = np.asarray(q)
    return q[np.isfinite(q).argmax(0), np.arange(q.shape[1])]


def pad(samples: Sample, length: int) -> Sample:
    """Lengthen a log by samples that change nothing (dt = 0, all NaN), so that logs stack for vmap.

    NumPy arrays stay NumPy arrays, because JAX would compile a separate program for every other length.
    """
    missing = length - samples.dt.shape[0]
    if missing < 0:
        raise ValueError(f"cannot pad {samples.dt.shape[0]} samples to {length}")
    return _pad(np, samples, missing) if isinstance(samples.dt, np.ndarray) else _pad_by_jax(samples, missing)


def _pad(xp: Any, samples: Sample, missing: int) -> Sample:
    def lengthen(x: Array, value: float) -> Array:
        return xp.concatenate([x, xp.full((missing, *x.shape[1:]), value, x.dtype)])

    q, dq, wrench = (lengthen(x, np.nan) for x in samples[1:4])
    temperature, columns = jax.tree.map(lambda x: xp.pad(x, (0, missing), mode="edge"), samples[4:6])
    rezeroed = None if samples.rezeroed is None else lengthen(samples.rezeroed, 0.0)
    return Sample(lengthen(samples.dt, 0.0), q, dq, wrench, temperature, columns, rezeroed)


_pad_by_jax = jax.jit(partial(_pad, jnp), static_argnames="missing")
