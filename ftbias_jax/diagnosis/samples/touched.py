"""Contact as the filter finds it, before anything is fitted: a second witness for what single samples and bins show."""

from __future__ import annotations

import numpy as np

from ftbias_jax.filtering.method.blocks import in_blocks, without_jumps
from ftbias_jax.filtering.method.contact import Contact, find_contacts
from ftbias_jax.filtering.method.log_noise import LEAST_BLOCKS
from ftbias_jax.io.log import Log


def contacts_in(log: Log, error: np.ndarray, speed: np.ndarray, variance: np.ndarray) -> tuple[Contact, ...]:
    """Stretches in which the reading leaves the model suddenly and comes back, by the rules of the filter.

    Args:
        log: as read.
        error: (T, 6) N, Nm, the model's prediction less the wrench.
        speed: (T, n) rad/s, of the joints.
        variance: (T, 6) N^2, Nm^2, of a sample.
    """
    blocks = without_jumps(in_blocks(log.t, error, speed, variance), log.rezeroed_at)
    return tuple(find_contacts(blocks)) if len(blocks.t) >= LEAST_BLOCKS else ()
