"""The results of many logs that were filtered in one call, and what became of those that could not be."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar, overload

from ftbias_jax.errors import FtbiasError, UsageError
from ftbias_jax.filtering.verbs.results import FilterResult

Source = TypeVar("Source")


@dataclass(frozen=True, eq=False)
class FilterResults(Sequence["FilterResult | None"]):
    """A sequence of results in the order of the logs; None = the log could not be filtered, and ``errors`` says why."""

    results: tuple[FilterResult | None, ...]
    """One for each log."""
    errors: Mapping[int, FtbiasError]
    """Position of a log -> why it has no result, with file, field, value and remedy."""

    @overload
    def __getitem__(self, index: int) -> FilterResult | None: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[FilterResult | None, ...]: ...
    def __getitem__(self, index: int | slice) -> FilterResult | tuple[FilterResult | None, ...] | None:
        return self.results[index]

    def __len__(self) -> int:
        return len(self.results)

    def __str__(self) -> str:
        done = [result for result in self.results if result is not None]
        samples, seconds = sum(len(x.t) for x in done), sum(x.summary.seconds for x in done)
        lines = [f"{len(done)} of {len(self)} logs filtered: {samples} wrench samples, {seconds:.1f} s"]
        lines += [f"log {i}: {line}" for i, x in enumerate(self.results) if x is not None for line in x.warnings]
        return "\n".join([*lines, *(f"log {i} has no result: {error}" for i, error in self.errors.items())])


def filter_each(logs: Iterable[Source], filter_one: Callable[[Source], FilterResult]) -> FilterResults:
    """Filter one log after the other; what is wrong with one does not keep the others from their results.

    Args:
        logs: taken one at a time, so that a generator need not hold them all.
        filter_one: the result of a log.

    Raises:
        UsageError: there is no log.
    """
    results: list[FilterResult | None] = []
    errors: dict[int, FtbiasError] = {}
    for i, log in enumerate(logs):
        try:
            results.append(filter_one(log))
        except FtbiasError as error:
            results.append(None)
            errors[i] = error
    if not results:
        raise UsageError("there is no log to filter", field="log", remedy="give at least one")
    return FilterResults(tuple(results), errors)
