"""Parts of logs that a calibration uses."""

from collections.abc import Sequence

import numpy as np

from ftbias_jax.io.cleaning import clean
from ftbias_jax.io.log import Log


def without_end(log: Log, hold_out: float) -> Log:
    """A log without wrench readings in its held-out end; of the same length, so that both share compiled programs."""
    seen = np.arange(len(log.t)) < max(1, round((1 - hold_out) * len(log.t)))
    return log._replace(wrench=np.where(seen[:, None], log.wrench, np.nan))


def longest(logs: Sequence[Log]) -> Log:
    """The longest of the logs, cleaned."""
    return clean(max(logs, key=lambda log: float(log.t[-1] - log.t[0])))
