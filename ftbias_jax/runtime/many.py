"""Many tasks in one call, done here or by the workers of an executor: their results in order, or why there is none."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import TypeVar, overload

from ftbias_jax.errors import FtbiasError, LogError, UsageError
from ftbias_jax.runtime.executors import run_with

Task = TypeVar("Task")
Result = TypeVar("Result")

LOST = "its workers were lost again and again: too little memory?"


def do_each(
    work: Callable[[Task], Result],
    tasks: Iterable[Task],
    executor: Executor | None,
    told: Callable[[Result | None], object] = lambda result: None,
) -> list[Result | None]:
    """Results of work (``run_with``) in the order of the tasks; None = the workers of a task were lost again and again.

    Tasks are taken one at a time, by the executor's workers or this thread; ``told`` gets each result as it gets ready.
    """
    found: dict[int, Result | None] = {}
    numbered = enumerate(tasks)
    each = run_with(executor, partial(_numbered, work), numbered) if executor else ((x, work(x[1])) for x in numbered)
    for (i, _), result in each:
        found[i] = result
        told(result)
    return [found[i] for i in range(len(found))]


@dataclass(frozen=True, eq=False)
class Results(Sequence[Result | None]):
    """A sequence of results in the order of the logs; None = a log has none, and ``errors`` says why."""

    results: tuple[Result | None, ...]
    """One for each log."""
    errors: Mapping[int, FtbiasError]
    """Position of a log -> why it has no result, with file, field, value and remedy."""

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
        """A line for every log without a result."""
        return [f"log {i} has no result: {error}" for i, error in self.errors.items()]


def results_of(
    work: Callable[[Task], Result],
    logs: Iterable[Task],
    executor: Executor | None,
    told: Callable[[Result | FtbiasError | None], object] = lambda result: None,
    sets: Callable[[Iterable[Task]], Iterable[Result | FtbiasError]] | None = None,
) -> Results[Result]:
    """The result of every log, or path of one, by itself, or why it has none; otherwise as ``do_each``.

    Where there is ``sets``, it works on as many at a time as it likes, and ``work`` and the executor are not used.

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
        found = do_each(partial(_or_error, work), noted(), executor, told)
    else:
        for result in sets(noted()):
            told(result)
            found.append(result)
    if not found:
        raise UsageError("there is no log", field="logs", remedy="give at least one")
    told_of = [LogError(LOST, file=name) if one is None else one for name, one in zip(named, found, strict=True)]
    errors = {i: one for i, one in enumerate(told_of) if isinstance(one, FtbiasError)}
    return Results(tuple(None if isinstance(one, FtbiasError) else one for one in told_of), errors)


def _or_error(work: Callable[[Task], Result], log: Task) -> Result | FtbiasError:
    try:
        return work(log)
    except FtbiasError as error:
        return error


def do_all(work: Callable[[Task], Result], tasks: Iterable[Task], executor: Executor | None) -> list[Result]:
    """The same where an answer needs all results.

    Raises:
        UsageError: the workers of one were lost again and again.
    """
    found = do_each(work, tasks, executor)
    if executor is not None and any(result is None for result in found):
        raise UsageError(LOST, field="executor", remedy="give its workers more memory, or leave out the executor")
    return [result for result in found if result is not None]


def _numbered(work: Callable[[Task], Result], numbered: tuple[int, Task]) -> Result:
    return work(numbered[1])
