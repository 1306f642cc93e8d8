"""Tasks done one after the other, or by several processes that do not take each other down."""

import multiprocessing
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from ftbias_jax.runtime.executors import Own, run_with
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
    with Processes(jobs) as processes:
        yield from run_with(processes, work, tasks, jobs)


class Processes(Own):
    """So many processes, and new ones where the system killed one, for all are lost with it."""

    def __init__(self, jobs: int) -> None:
        self._jobs, self._pool = jobs, _pool(jobs)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """As of every executor."""
        with interrupts_blocked():  # submitting starts processes
            try:
                return self._pool.submit(fn, *args, **kwargs)
            except BrokenProcessPool:
                self._pool = _pool(self._jobs)
                return self._pool.submit(fn, *args, **kwargs)

    def again(self, fn: Callable[..., Any], /, *args: Any) -> Future[Any]:
        """A task whose process was lost, in one of its own: the guilty one shows when it is alone."""
        stop_if_ending()
        with _pool(1) as pool:
            future = pool.submit(fn, *args)
            wait([future])
        stop_if_ending()
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """As of every executor."""
        self._pool.shutdown(wait, cancel_futures=cancel_futures)


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
