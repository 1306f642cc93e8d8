"""Bounds on what work may cost, whatever a file declares."""

import resource
import sys
import time
from contextlib import contextmanager

_BYTES = 1 if sys.platform == "darwin" else 1024
"""Bytes per unit in which the system counts memory."""


@contextmanager
def bounded(seconds=60.0, mebibytes=1 << 20):
    """Check that the work takes less time, and less memory beyond the peak of the process so far."""
    before, started = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.perf_counter()
    yield
    assert time.perf_counter() - started < seconds
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * _BYTES < mebibytes << 20
