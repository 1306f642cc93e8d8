"""Tasks done one after the other, or by several processes that do not take each other down."""

from __future__ import annotations

import multiprocessing
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from ftbias_jax.runtime.jax_config import prepare_jax
from ftbias_jax.runtime.signals import (
    end_on_signals,
    end_with_parent,
    ignore_interrupts,
    interrupts_blocked,
    stop_if_ending,
)

Task = TypeVar("Task")
Result = TypeVar("Result")


def run_each(work: Callable[[Task], Result], tasks: Iterable[Task], jobs: int) -> Iterator[tuple[Task, Result | None]]:
    """Every task with its result as it gets ready, or with None if its process was killed.

    Args:
        work: what to do; for several processes it can be pickled.
        tasks: each once.
        jobs: how many at a time; 1 = in this process, where JAX is as the caller prepared it.
    """
    if jobs == 1:
        yield from ((task, work(task)) for task in tasks)
        return
    waiting = deque(tasks)
    while waiting:
        flying: dict[Future[Result], Task] = {}
        try:
            with _pool(jobs) as pool:
                while waiting or flying:
                    while waiting and len(flying) < jobs:
                        with interrupts_blocked():  # submitting starts processes
                            future = pool.submit(work, waiting[0])  # a broken pool takes none: the task still waits
                        flying[future] = waiting.popleft()
                    for future in wait(flying, return_when=FIRST_COMPLETED).done:
                        yield flying[future], future.result()
                        del flying[future]
        except BrokenProcessPool:
            stop_if_ending()
            # The system killed a process, and all in the pool are lost with it: the guilty one shows when it is alone.
            for task in flying.values():
                yield task, _alone(work, task)


def _alone(work: Callable[[Task], Result], task: Task) -> Result | None:
    try:
        with _pool(1) as pool:
            return pool.submit(work, task).result()
    except BrokenProcessPool:
        stop_if_ending()
        return None


def _pool(jobs: int) -> ProcessPoolExecutor:
    # Spawned, not forked: JAX runs threads, which a fork would leave behind in the middle of what they do.
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(jobs, mp_context=context, initializer=_prepare)


def _prepare() -> None:
    """What every process of a pool does first."""
    ignore_interrupts()
    end_on_signals()
    end_with_parent()
    prepare_jax()
