"""The parts of logs that a calibration looks at."""

from collections.abc import Sequence

import numpy as np

from ftbias_jax.io.cleaning import clean
from ftbias_jax.io.log import Log


def without_end(log: Log, hold_out: float) -> Log:
    """A log whose sensor reads nothing in its last part: of the same length, so that both share their programs."""
    seen = np.arange(len(log.t)) < max(1, round((1 - hold_out) * len(log.t)))
    return log._replace(wrench=np.where(seen[:, None], log.wrench, np.nan))


def longest(logs: Sequence[Log]) -> Log:
    """The longest of some logs, cleaned."""
    return clean(max(logs, key=lambda log: float(log.t[-1] - log.t[0])))
