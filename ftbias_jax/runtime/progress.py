"""Progress of a long task on standard error: a bar on a terminal, sparse plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from typing import TextIO


class Progress:
    """Call it with the amount done; nothing is shown for tasks shorter than two seconds.

    Args:
        label: what is being done.
        total: the amount that is everything.
        stream: where to write.
    """

    def __init__(self, label: str, total: float, stream: TextIO | None = None) -> None:
        self._label, self._total, self._stream = label, total or 1, stream if stream is not None else sys.stderr
        self._terminal = self._stream.isatty()
        self._start = time.monotonic()
        self._next = self._start + 2.0
        self._shown = False

    def __call__(self, done: float) -> None:
        """Report that ``done`` of ``total`` is finished."""
        now = time.monotonic()
        finished = done >= self._total
        if now < self._next and not (finished and self._shown):
            return
        self._shown = True
        self._next = now + (0.2 if self._terminal else 10.0)
        share = min(done / self._total, 1.0)
        elapsed = now - self._start
        left = f", {elapsed * (1 - share) / share:.0f} s left" if 0 < share < 1 else ""
        text = f"{self._label}: {share:4.0%} after {elapsed:.0f} s{left}"
        if self._terminal:
            bar = "#" * round(30 * share)
            self._stream.write(f"\r[{bar:<30}] {text}\x1b[K" + ("\n" if finished else ""))
        else:
            self._stream.write(text + "\n")
        self._stream.flush()
