"""Tasks done by an executor: of a cluster that people already run, Dask, Ray or MPI, or by processes of our own.

These do not take each other down: where the system kills one, its task is tried again by itself.
"""

import importlib
import multiprocessing
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from typing import Any, TypeVar

from ftbias_jax.errors import UsageError
from ftbias_jax.runtime.jax_config import in_float64, prepare_jax
from ftbias_jax.runtime.signals import end_with_parent, interrupts_blocked, stop_if_ending

Task = TypeVar("Task")
Result = TypeVar("Result")

IN_FLIGHT = 64
"""Bundles of tasks that an executor is given at a time: enough for as many workers, few enough to hold."""
MOST_TOGETHER = 32
"""Tasks of a bundle."""
TRIES = 2
"""Of a task whose worker is lost."""
PATIENCE = 20
"""s in which a scheduler must answer."""


def run_with(
    executor: Executor,
    work: Callable[[Task], Result],
    tasks: Iterable[Task],
    in_flight: int = IN_FLIGHT,
    seconds: float = 0.0,
) -> Iterator[tuple[Task, Result | None]]:
    """Every task with its result as it gets ready, or with None if its workers were lost again and again.

    Args:
        executor: the caller's own, which stays open.
        work: what to do, in float64; can be pickled. What it raises is raised here.
        tasks: each once; taken from a generator as workers get free.
        in_flight: bundles of tasks at a time.
        seconds: of work in a bundle, as those before took: a scheduler takes milliseconds to hand one out. 0 = a task
            by itself, also where tasks hold much data.

    Raises:
        UsageError: the executor takes no more tasks.
    """
    waiting, together = iter(tasks), 1
    flying = dict[Future[tuple[list[Result], Exception | None, float]], tuple[tuple[Task, ...], int]]()

    def submit(bundle: tuple[Task, ...], tried: int) -> None:
        how = executor.again if tried and isinstance(executor, Processes) else executor.submit
        try:
            flying[how(_in_float64, work, bundle)] = bundle, tried + 1
        except (BrokenExecutor, RuntimeError) as error:
            message = f"the executor takes no more tasks: {error}"
            raise UsageError(message, field="executor", remedy="start it again; what is done stays done") from error

    while True:
        while len(flying) < in_flight and (bundle := tuple(islice(waiting, together))):
            submit(bundle, 0)
        if not flying:
            return
        for future in wait(flying, return_when=FIRST_COMPLETED).done:
            bundle, tried = flying.pop(future)
            if future.exception() is None:
                results, error, took = future.result()
                if error is not None:
                    raise error
                together = min(max(int(seconds * len(bundle) / max(took, 1e-9)), 1), MOST_TOGETHER)
                yield from zip(bundle, results, strict=True)
            elif tried < TRIES:
                for task in bundle:  # by itself: the guilty one shows when it is alone
                    submit((task,), tried)
            else:
                yield from ((task, None) for task in bundle)


def _in_float64(work: Callable[[Task], Result], bundle: Iterable[Task]) -> tuple[list[Result], Exception | None, float]:
    """The results, or what the work raised: an exception of its own is no loss of a worker; and the seconds it took."""
    started, results = time.perf_counter(), list[Result]()
    try:
        results += map(in_float64(work), bundle)
    except Exception as error:
        return results, error, 0.0
    return results, None, time.perf_counter() - started


def run_each(work: Callable[[Task], Result], tasks: Iterable[Task], jobs: int) -> Iterator[tuple[Task, Result | None]]:
    """Every task with its result as it gets ready, or with None if its process was killed.

    So many ``jobs`` are done at a time, by work that can be pickled; with 1 in this process, where JAX is as the caller
    prepared it.
    """
    if jobs == 1:
        yield from ((task, work(task)) for task in tasks)
        return
    with Processes(jobs) as processes:
        yield from run_with(processes, work, tasks, jobs)


class Processes(Executor):
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
    end_with_parent()
    prepare_jax()


@contextmanager
def executor_of(name: str) -> Iterator[Executor]:
    """The executor of a cluster: "dask:tcp://HOST:PORT", "ray" or "ray:ADDRESS".

    Raises:
        UsageError: no such cluster, or its package is not installed.
    """
    kind, _, address = name.partition(":")
    try:
        if kind == "dask" and address:
            distributed: Any = importlib.import_module("distributed")
            with distributed.Client(address, timeout=PATIENCE, set_as_default=False) as client:
                # A log may be another one although its path is the same: nothing is taken from earlier results.
                yield client.get_executor(pure=False)
        elif kind == "ray":
            ray = importlib.import_module("ray")
            with warnings.catch_warnings():
                # JAX warns of forks; Ray's replace themselves by other programs at once.
                warnings.filterwarnings("ignore", r"os\.fork\(\) was called", RuntimeWarning)
                ray.init(address or None, ignore_reinit_error=True, log_to_driver=False)
            try:
                yield _Ray(ray)
            finally:
                ray.shutdown()
        else:
            raise UsageError(f"got {name!r}", field="executor", remedy="give dask:tcp://HOST:PORT or ray")
    except ImportError as error:
        remedy = f"pip install 'ftbias-jax[{kind}]'"
        raise UsageError(f"needs the package {error.name}", field="executor", remedy=remedy) from error
    except (OSError, ConnectionError) as error:
        raise UsageError(f"no cluster answers at {address!r}: {error}", field="executor", remedy="start it") from error


class _Ray(Executor):
    """Ray's tasks as futures."""

    def __init__(self, ray: Any) -> None:
        self.ray = ray

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        return self.ray.remote(fn).remote(*args, **kwargs).future()
