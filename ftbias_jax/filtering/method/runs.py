"""Runs of the method that logs request: one by one, or on an accelerator for a set of logs as one program.

The steps for a log are a generator. It yields the runs of the method that it needs, one after the other, receives the
result of each, and returns the result of the log.
"""

from collections import defaultdict
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from typing import Any, NamedTuple, TypeVar

import jax
import numpy as np

from ftbias_jax.errors import FtbiasError
from ftbias_jax.filtering.method.filter_samples import filter_each, filter_samples, method_for
from ftbias_jax.filtering.method.work import Infos, States
from ftbias_jax.filtering.noise.blocks import Layout
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.model.params import Params
from ftbias_jax.runtime.kept_programs import shapes_of
from ftbias_jax.types import Sample

SET_SAMPLES = 1 << 20
"""Samples that are processed together, padding included: each takes a few kB of the accelerator's memory."""

Result = TypeVar("Result")
Task = TypeVar("Task")
Found = tuple[Params, States, Infos]
"""Result of a run, in NumPy arrays."""
Steps = Generator["Run", Found, Result]
"""Steps for one log."""


class Run(NamedTuple):
    """The arguments of ``filter_samples``."""

    params: Params
    samples: Sample
    options: Options
    method: tuple[str, ...]
    layout: Layout

    def program(self) -> tuple[Any, ...]:
        """A key that is equal for runs that one program can do together."""
        leaves, tree = jax.tree.flatten((self.params, self.samples))
        method = method_for(self.samples, self.method, self.layout)
        return tree, shapes_of(leaves), self.options, method, self.layout


def alone(steps: Steps[Result]) -> Result:
    """The result of one log, with its runs executed as it requests them."""
    found: Any = None
    while True:
        try:
            params, samples, options, method, layout = steps.send(found)
        except StopIteration as end:
            result: Result = end.value
            return result
        found = jax.tree.map(np.asarray, filter_samples(params, samples, options, method=method, layout=layout))


def in_sets(
    start: Callable[[Task], Steps[Result]], device: Any, tasks: Iterable[Task]
) -> Iterator[Result | FtbiasError]:
    """Results of many logs in their order, or the error that prevented one; runs of one program are executed together.

    Args:
        start: a log -> its steps.
        device: JAX device that executes the runs; everything else is executed where this is called.
        tasks: the logs, taken from a generator as far as the next set needs.
    """
    steps, runs, done, room = list[Steps[Result]](), dict[int, Run](), dict[int, Result | FtbiasError](), 0

    def proceed(i: int, found: Any) -> None:
        try:
            runs[i] = steps[i].send(found)
        except StopIteration as end:
            done[i] = end.value
        except FtbiasError as error:
            done[i] = error

    def finish() -> Iterator[Result | FtbiasError]:
        while runs:
            by_program = defaultdict[Any, list[int]](list)
            for i, run in runs.items():
                by_program[run.program()].append(i)
            for program, alike in by_program.items():
                for i, found in zip(alike, _done_together(program, [runs.pop(i) for i in alike], device), strict=True):
                    proceed(i, found)
        yield from (done[i] for i in range(len(steps)))

    for task in tasks:
        steps.append(start(task))
        proceed(i := len(steps) - 1, None)
        room += len(runs[i].samples.dt) if i in runs else 0
        if room >= SET_SAMPLES:
            yield from finish()
            steps, runs, done, room = [], {}, {}, 0
    yield from finish()


def _done_together(program: tuple[Any, ...], runs: Sequence[Run], device: Any) -> list[Found]:
    """The result of each of some runs of one program."""
    count = 1 << (len(runs) - 1).bit_length()  # so that few sizes of sets are compiled
    rows = [(run.params, run.samples) for run in runs]
    stacked = jax.tree.map(lambda *x: np.stack(x), *rows, *rows[-1:] * (count - len(rows)))
    _, _, options, method, layout = program
    with jax.default_device(device):
        found = jax.tree.map(np.asarray, filter_each(*stacked, options=options, method=method, layout=layout))
    # Copied, because otherwise a result of which little is kept would hold the arrays of the whole set.
    return [jax.tree.map(lambda x, i=i: np.array(x[i]), found) for i in range(len(runs))]
