"""Handling of Ctrl-C and SIGTERM: the process ends immediately with its children and leaves no temporary files behind.

An exception raised at an arbitrary point of the program may be swallowed there (by a library's callback or a
destructor), and unwinding while compiled code runs in other threads has crashed. Therefore nothing is raised: a
separate thread waits for the signal, cleans up and ends the process, also while the main thread is in compiled code.
"""

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import util
from multiprocessing.connection import wait

from ftbias_jax.files import remove_temporary

EXIT_CODE = 1
PATIENCE = 2.0
"""s allowed for child processes to remove their temporary files."""
GIVING_BACK = 0.1
"""s allowed for the threads of a pool to finish releasing their semaphores."""

_ending = threading.Event()


def end_on_signals(message: str = "") -> None:
    """From now on, end this process when it is interrupted or terminated, with a message on standard error.

    Call it in the main thread. A signal that was ignored when the process started, as under nohup, stays ignored.
    """
    listen, tell = os.pipe()
    os.set_blocking(tell, False)
    signal.set_wakeup_fd(tell, warn_on_full_buffer=False)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, lambda *_: None)  # the wake-up file descriptor notifies the thread
    threading.Thread(target=_wait, args=(listen, message), daemon=True).start()


def end_with_parent() -> None:
    """``end_on_signals`` for a process of a pool, which leaves Ctrl-C to its parent and ends when the parent has ended.

    The terminal sends Ctrl-C to both; a parent that is killed cannot notify its children.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_on_signals()
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_wait_for_end, args=(parent.sentinel,), daemon=True).start()


@contextmanager
def interrupts_blocked() -> Iterator[None]:
    """Block Ctrl-C in processes started meanwhile, even before they can set their own signal handling."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def stop_if_ending() -> None:
    """Wait for the end of the process if it is being ended, so that its children's unfinished work is not reported."""
    while _ending.is_set():
        time.sleep(PATIENCE)


def _wait(listen: int, message: str) -> None:
    os.read(listen, 1)
    _ending.set()
    try:
        if message:
            sys.stdout.flush()
            os.write(2, message.encode())
        threading.excepthook = lambda *_: None  # errors of a terminated pool's threads are expected
        _end_children()
        remove_temporary()
        util._run_finalizers(0)  # type: ignore[attr-defined]  # else Python warns of leaked semaphores
        time.sleep(GIVING_BACK)
    finally:
        os._exit(EXIT_CODE)


def _wait_for_end(sentinel: int) -> None:
    wait([sentinel])
    remove_temporary()
    os._exit(EXIT_CODE)


def _end_children() -> None:
    children = multiprocessing.active_children()
    for child in children:
        child.terminate()
    deadline = time.monotonic() + PATIENCE
    for child in children:
        with suppress(AssertionError, OSError):  # the main thread may have joined it already
            child.join(max(deadline - time.monotonic(), 0))
    for child in children:
        child.kill()
