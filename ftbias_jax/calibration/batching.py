"""Logs of unequal length as bundles of equal shape, so that one compiled program works through them all."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.types import Array, Sample


def stack(logs: Sequence[Sample], length: int = 0) -> Sample:
    """Logs of unequal length as one bundle with a leading log axis, padded by samples that change nothing.

    At least one; ``length``: samples to pad to, if it is more than the longest has.
    """
    length = max(length, *(log.dt.shape[0] for log in logs))

    def fill(value: float, *leaves: Array) -> jax.Array:
        # numpy, for every new shape would cost JAX a compilation
        filled = np.full((len(logs), length, *leaves[0].shape[1:]), value, leaves[0].dtype)
        for row, leaf in zip(filled, leaves, strict=True):
            row[: len(leaf)] = leaf
        return jnp.asarray(filled)

    if any(log.rezeroed is not None for log in logs):
        logs = [log._replace(rezeroed=np.zeros(len(log.dt)) if log.rezeroed is None else log.rezeroed) for log in logs]
    everywhere = {name for name in Sample._fields if all(getattr(log, name) is not None for log in logs)}
    rest = [log._replace(dt=None, **dict.fromkeys(set(Sample._fields[1:]) - everywhere)) for log in logs]
    stacked: Sample = jax.tree.map(partial(fill, np.nan), *rest)
    rezeroed = None if stacked.rezeroed is None else jnp.nan_to_num(stacked.rezeroed)
    return stacked._replace(dt=fill(0.0, *(log.dt for log in logs)), rezeroed=rezeroed)


def cut(log: Sample, length: int) -> list[Sample]:
    """Pieces of at most so many samples of the joints, equally long, each starting as a log of its own."""
    whole = Sample(*(np.asarray(x) for x in log[:4]))  # joints do not feel the temperature
    count = -(-len(whole.dt) // length)
    ends = [len(whole.dt) * i // count for i in range(count + 1)]
    pieces = [Sample(*(x[start:end] for x in whole[:4])) for start, end in itertools.pairwise(ends)]
    return [piece._replace(dt=np.concatenate([[0], piece.dt[1:]])) for piece in pieces]


def equal_parts(logs: list[Sample], at_once: int) -> list[list[Sample]]:
    """Parts of equally many logs, at most ``at_once``, some filled up by a log that measured nothing.

    Those of a part are about as long as each other, because work on a part takes the time of its longest log. The first
    parts are to speak for all, so parts of all lengths take turns.
    """
    count = -(-len(logs) // at_once)
    size = -(-len(logs) // count)
    nothing = jax.tree.map(lambda x: np.full_like(x[:1], np.nan), logs[0])._replace(dt=np.zeros(1))
    filled = [nothing] * (count * size - len(logs)) + sorted(logs, key=lambda log: len(log.dt))
    parts = [filled[i : i + size] for i in range(0, len(filled), size)]
    stride = math.isqrt(count)
    return [part for first in reversed(range(stride)) for part in parts[first::stride]]
