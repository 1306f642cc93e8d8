"""One log from file to file: read in parts, filtered, written. What ``ftbias filter`` does for every log."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from typing import NamedTuple

from ftbias_jax.filtering import filter_log
from ftbias_jax.filtering.pipeline import options_from_setup
from ftbias_jax.filtering.quality import observability, summary
from ftbias_jax.filtering.quality.summary import Summary
from ftbias_jax.filtering.result import Filtered, join
from ftbias_jax.filtering.samples import samples_from_log
from ftbias_jax.io.log import Repairs
from ftbias_jax.io.parts import OpenLog
from ftbias_jax.io.write import save_results
from ftbias_jax.io.write.npz import save_npz_parts
from ftbias_jax.model.params import Params
from ftbias_jax.setup.types import Setup


class Choices(NamedTuple):
    """What a user asked for, beside the setup."""

    smooth: bool = False
    """Add the bias given past and future."""


DEFAULT_CHOICES = Choices()


class Outcome(NamedTuple):
    """What came out, beside the file."""

    summary: Summary
    params: Params
    repairs: Repairs
    """What was mended or lost, for the owner to know."""
    filtered: Filtered
    """The whole result if it was asked for, otherwise the last part of it."""

    @property
    def lost(self) -> bool:
        """Whether samples were left out or an axis was never measured."""
        return any(repair.lost for repair in self.repairs)


def filter_file(
    log: OpenLog,
    setup: Setup,
    output: str | os.PathLike[str],
    choices: Choices = DEFAULT_CHOICES,
    progress: Callable[[float], None] = lambda share: None,
    *,
    keep: bool = False,
) -> Outcome:
    """Filter a log into a file, which appears whole or not at all.

    A long NPZ log into an NPZ file takes memory for its stamps and for a few chunks; everything else is held whole.

    Args:
        log: what to filter.
        setup: what to filter.
        output: the file; its suffix names the format.
        choices: see there.
        progress: told the share that is done.
        keep: also return the result.

    Raises:
        LogError: the log is damaged. OutputError, UsageError: the result cannot be written.
    """
    options = options_from_setup(setup)
    likeliest = filter_log.likeliest_params(setup, samples_from_log(next(log.parts(filter_log.CHUNK))), options)
    params = filter_log.guard_against_lag(likeliest)
    size = filter_log.CHUNK if params.effects is None else log.length  # effects with a memory need the whole log
    tally, turning = summary.start(), observability.start()

    def results() -> Iterator[Filtered]:
        nonlocal tally, turning
        for i, part in enumerate(filter_log.filter_parts(params, log.facts.first_q, log.parts(size), options), 1):
            tally, turning = summary.add(tally, part), observability.add(turning, params, part)
            progress(min(i * size / log.length, 1.0))
            yield part

    if keep or choices.smooth or not os.fspath(output).lower().endswith(".npz"):
        filtered = join(list(results()))
        arrays = filtered._asdict()
        if choices.smooth:
            mean, std = filter_log.smooth_with_params(likeliest, log.whole(), options)
            arrays |= {"bias_smooth": mean[:, 0], "drift_smooth": mean[:, 1]}
            arrays |= {"bias_smooth_std": std[:, 0], "drift_smooth_std": std[:, 1]}
        save_results(output, arrays, log.start)
    else:
        save_npz_parts(output, (part._asdict() for part in results()))
        assert tally.last is not None  # no log is empty
        filtered = tally.last
    repairs = (*log.repairs, *observability.remarks(turning))
    return Outcome(summary.finish(tally), params, repairs, filtered)
