"""Progress of a long task on standard error: a bar or the stage on a terminal, sparse plain lines elsewhere."""

from __future__ import annotations

import sys
import threading
import time
from types import TracebackType
from typing import TextIO

QUIET = 2.0
"""s before anything is shown; a shorter task shows nothing."""
OFTEN, SELDOM = 0.2, 10.0
"""s between messages, on a terminal and elsewhere."""


class Progress:
    """Progress display, called with the amount done out of ``total``; tasks shorter than two seconds show nothing."""

    def __init__(self, label: str, total: float, stream: TextIO | None = None) -> None:
        self._label, self._total, self._stream = label, total or 1, stream if stream is not None else sys.stderr
        self._terminal = self._stream.isatty()
        self._start = time.monotonic()
        self._next = self._start + QUIET
        self._shown = False

    def __call__(self, done: float) -> None:
        """Report that ``done`` of ``total`` is finished."""
        now = time.monotonic()
        finished = done >= self._total
        if now < self._next and not (finished and self._shown):
            return
        self._shown = True
        self._next = now + (OFTEN if self._terminal else SELDOM)
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


class Stages:
    """Display of the current stage of a task of unknown duration, called with the name of each stage as it begins.

    It is written by a separate thread, because a stage may be in compiled code, and is erased at the end on a terminal.
    """

    def __init__(self, label: str, stream: TextIO | None = None) -> None:
        self._label, self._stream = label, stream if stream is not None else sys.stderr
        self._terminal = self._stream.isatty()
        self._stage = ""
        self._start = time.monotonic()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._show, daemon=True)

    def __enter__(self) -> Stages:
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._ended.set()
        self._thread.join()

    def __call__(self, stage: str) -> None:
        """Report that a stage begins."""
        self._stage = stage

    def _show(self) -> None:
        shown, last_shown = "", -SELDOM
        if self._ended.wait(QUIET):
            return
        while True:
            elapsed, stage = time.monotonic() - self._start, self._stage
            text = f"{self._label}: {stage}, {elapsed:.0f} s"
            if self._terminal:
                self._stream.write(f"\r{text}\x1b[K")
            elif stage != shown or elapsed - last_shown >= SELDOM:
                self._stream.write(f"{text}\n")
                shown, last_shown = stage, elapsed
            self._stream.flush()
            if self._ended.wait(OFTEN):
                break
        if self._terminal:
            self._stream.write("\r\x1b[K")
            self._stream.flush()


def silent(stage: str) -> None:
    """Callback for stages that shows nothing."""
