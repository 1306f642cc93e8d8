"""Run tasks on an executor: that of an existing cluster (Dask, Ray or MPI), or local worker processes.

If the operating system kills a local process, the tasks lost with it are retried, each in a process of its own.
"""

import importlib
import multiprocessing
import pickle
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
"""Bundles of tasks submitted to an executor at a time: enough for as many workers, few enough to hold in memory."""
MOST_TOGETHER = 32
"""Maximum number of tasks per bundle."""
TRIES = 2
"""Number of attempts at a task whose worker is lost each time, before it is given up."""
NOT_PORTABLE = (pickle.PickleError, AttributeError, ImportError, TypeError)
"""Errors of a call that cannot be sent to a worker, or whose result cannot be sent back: no worker was lost."""
PATIENCE = 20
"""s within which a cluster's scheduler must answer."""


def run_with(
    executor: Executor,
    work: Callable[[Task], Result],
    tasks: Iterable[Task],
    in_flight: int = IN_FLIGHT,
    seconds: float = 0.0,
) -> Iterator[tuple[Task, Result | None]]:
    """Yield every task with its result as it becomes ready, or with None if its workers were lost repeatedly.

    Args:
        executor: belongs to the caller and stays open.
        work: function of a task, run in float64; must be picklable. Exceptions that it raises are re-raised here.
        tasks: each is done once; they are taken from the iterable as workers become free.
        in_flight: maximum number of bundles of tasks submitted at a time.
        seconds: target duration of a bundle, estimated from earlier ones, because a scheduler takes milliseconds to
            dispatch one; 0 = one task per bundle, also suitable where tasks hold much data.

    Raises:
        UsageError: it is no executor, it accepts no more tasks, or its workers cannot load the call or return a result.
    """
    if not hasattr(executor, "submit"):
        remedy = "give a concurrent.futures.Executor, as dask.distributed.Client(ADDRESS).get_executor()"
        raise UsageError(f"got {executor!r}, which is no executor", field="executor", remedy=remedy)
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
            failure = future.exception()
            if isinstance(failure, NOT_PORTABLE):
                remedy = "use the same versions there, and functions that are defined in a module"
                message = f"its workers cannot load the call or return the result: {failure}"
                raise UsageError(message, field="executor", remedy=remedy) from failure
            if failure is None:
                results, error, took = future.result()
                if error is not None:
                    raise error
                together = min(max(int(seconds * len(bundle) / max(took, 1e-9)), 1), MOST_TOGETHER)
                yield from zip(bundle, results, strict=True)
            elif tried < TRIES:
                for task in bundle:  # each separately, which shows the task that kills its worker
                    submit((task,), tried)
            else:
                yield from ((task, None) for task in bundle)


def _in_float64(work: Callable[[Task], Result], bundle: Iterable[Task]) -> tuple[list[Result], Exception | None, float]:
    """The results, the exception that the work raised (which is not a lost worker) or None, and the elapsed seconds."""
    started, results = time.perf_counter(), list[Result]()
    try:
        results += map(in_float64(work), bundle)
    except Exception as error:
        return results, error, 0.0
    return results, None, time.perf_counter() - started


def run_each(work: Callable[[Task], Result], tasks: Iterable[Task], jobs: int) -> Iterator[tuple[Task, Result | None]]:
    """Yield every task with its result as it becomes ready, or with None if its process was killed.

    ``jobs`` tasks are done at a time, each in a process, by picklable work; with 1 they are done in this process, where
    JAX stays as the caller configured it.
    """
    if jobs == 1:
        yield from ((task, work(task)) for task in tasks)
        return
    with Processes(jobs) as processes:
        yield from run_with(processes, work, tasks, jobs)


class Processes(Executor):
    """A pool of ``jobs`` processes, replaced by a new pool if the system kills one, because all are lost with it."""

    def __init__(self, jobs: int) -> None:
        self._jobs, self._pool = jobs, _pool(jobs)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Submit a call, as ``Executor.submit``."""
        with interrupts_blocked():  # submitting starts processes
            try:
                return self._pool.submit(fn, *args, **kwargs)
            except BrokenProcessPool:
                self._pool = _pool(self._jobs)
                return self._pool.submit(fn, *args, **kwargs)

    def again(self, fn: Callable[..., Any], /, *args: Any) -> Future[Any]:
        """Run a task whose process was lost in a process of its own, which shows whether it is the cause."""
        stop_if_ending()
        with _pool(1) as pool:
            future = pool.submit(fn, *args)
            wait([future])
        stop_if_ending()
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Shut the pool down, as ``Executor.shutdown``."""
        self._pool.shutdown(wait, cancel_futures=cancel_futures)


def _pool(jobs: int) -> ProcessPoolExecutor:
    # Spawned, not forked: JAX runs threads, which a fork would cut off in the middle of their work.
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(jobs, mp_context=context, initializer=_prepare)


def _prepare() -> None:
    """Initialise a process of a pool."""
    end_with_parent()
    prepare_jax()


@contextmanager
def executor_of(name: str) -> Iterator[Executor]:
    """Connect to the executor of a cluster: "dask:tcp://HOST:PORT", "ray" or "ray:ADDRESS".

    Raises:
        UsageError: there is no such cluster, or its package is not installed.
    """
    kind, _, address = name.partition(":")
    try:
        if kind == "dask" and address:
            distributed: Any = importlib.import_module("distributed")
            with distributed.Client(address, timeout=PATIENCE, set_as_default=False) as client:
                # The same path may name another log than before, so earlier results must not be reused.
                yield client.get_executor(pure=False)
        elif kind == "ray":
            ray = importlib.import_module("ray")
            with warnings.catch_warnings():
                # JAX warns of forks, but Ray's forked processes immediately execute another program.
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
    """Adapter that submits calls as Ray tasks and returns futures."""

    def __init__(self, ray: Any) -> None:
        self.ray = ray

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        return self.ray.remote(fn).remote(*args, **kwargs).future()
