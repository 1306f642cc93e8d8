"""Many tasks in one call, in this process or on an executor: their results in order, or the error of each failure."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import TypeVar, overload

from ftbias_jax.errors import FtbiasError, LogError, UsageError
from ftbias_jax.runtime.executors import run_with

Task = TypeVar("Task")
Result = TypeVar("Result")

LOST = "its workers died repeatedly, possibly for lack of memory"


def do_each(
    work: Callable[[Task], Result],
    tasks: Iterable[Task],
    executor: Executor | None,
    on_result: Callable[[Result | None], object] = lambda result: None,
) -> list[Result | None]:
    """Results of ``work`` (``run_with``) in the order of the tasks; None = a task's workers were lost repeatedly.

    Tasks are taken one at a time, by the executor's workers or this thread; ``on_result`` gets each result when ready.
    """
    found: dict[int, Result | None] = {}
    numbered = enumerate(tasks)
    each = run_with(executor, partial(_numbered, work), numbered) if executor else ((x, work(x[1])) for x in numbered)
    for (i, _), result in each:
        found[i] = result
        on_result(result)
    return [found[i] for i in range(len(found))]


@dataclass(frozen=True, eq=False)
class Results(Sequence[Result | None]):
    """Sequence of results in the order of the logs; None = the log has no result, and ``errors`` states why."""

    results: tuple[Result | None, ...]
    """One result per log; None = the log has none."""
    errors: Mapping[int, FtbiasError]
    """Index of a log without a result -> its error, with file, field, value and remedy."""

    @overload
    def __getitem__(self, index: int) -> Result | None: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Result | None, ...]: ...
    def __getitem__(self, index: int | slice) -> Result | tuple[Result | None, ...] | None:
        return self.results[index]

    def __len__(self) -> int:
        return len(self.results)

    def __str__(self) -> str:
        words = [f"{len(self) - len(self.errors)} of {len(self)} logs have a result"]
        return "\n".join([*words, *self.failed()])

    def failed(self) -> list[str]:
        """One line for every log without a result."""
        return [f"log {i} has no result: {error}" for i, error in self.errors.items()]


def results_of(
    work: Callable[[Task], Result],
    logs: Iterable[Task],
    executor: Executor | None,
    on_result: Callable[[Result | FtbiasError | None], object] = lambda result: None,
    sets: Callable[[Iterable[Task]], Iterable[Result | FtbiasError]] | None = None,
) -> Results[Result]:
    """Process every log, or path of a log, separately and return its result or error; otherwise as ``do_each``.

    If ``sets`` is given, it processes the logs in groups of its own choice; ``work`` and the executor are not used.

    Raises:
        UsageError: there is no log.
    """
    named = list[str]()

    def noted() -> Iterator[Task]:
        for log in logs:
            named.append(log if isinstance(log, str) else "")
            yield log

    found = list[Result | FtbiasError | None]()
    if sets is None:
        found = do_each(partial(_or_error, work), noted(), executor, on_result)
    else:
        for result in sets(noted()):
            on_result(result)
            found.append(result)
    if not found:
        raise UsageError("there is no log", field="logs", remedy="give at least one")
    results_or_errors = [
        LogError(LOST, file=name) if one is None else one for name, one in zip(named, found, strict=True)
    ]
    errors = {i: one for i, one in enumerate(results_or_errors) if isinstance(one, FtbiasError)}
    return Results(tuple(None if isinstance(one, FtbiasError) else one for one in results_or_errors), errors)


def _or_error(work: Callable[[Task], Result], log: Task) -> Result | FtbiasError:
    try:
        return work(log)
    except FtbiasError as error:
        return error


def do_all(work: Callable[[Task], Result], tasks: Iterable[Task], executor: Executor | None) -> list[Result]:
    """Results of ``work`` in the order of the tasks, where all results are required.

    Raises:
        UsageError: the workers of a task were lost repeatedly.
    """
    found = do_each(work, tasks, executor)
    if executor is not None and any(result is None for result in found):
        raise UsageError(LOST, field="executor", remedy="give its workers more memory, or leave out the executor")
    return [result for result in found if result is not None]


def _numbered(work: Callable[[Task], Result], numbered: tuple[int, Task]) -> Result:
    return work(numbered[1])
