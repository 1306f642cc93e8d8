"""One log from file to file: read in parts, filtered, written. What ``ftbias filter`` does for every log."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from typing import NamedTuple

from ftbias_jax import batch, excitation, summary
from ftbias_jax.filtered import Filtered, join
from ftbias_jax.logs.parts import OpenLog
from ftbias_jax.logs.repairs import Repair, Repairs
from ftbias_jax.pipeline import Params, options_from_setup, samples_from_log
from ftbias_jax.results import save_npz_parts
from ftbias_jax.setup_types import Setup
from ftbias_jax.summary import Summary
from ftbias_jax.types import AXES
from ftbias_jax.writers import save_results


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
        log, setup: what to filter. output: the file; its suffix names the format. choices: see there.
        progress: told the share that is done. keep: also return the result.

    Raises:
        LogError: the log is damaged. OutputError, UsageError: the result cannot be written.
    """
    options = options_from_setup(setup)
    likeliest = batch.likeliest_params(setup, samples_from_log(next(log.parts(batch.CHUNK))), options)
    params = batch.guard_against_lag(likeliest)
    size = batch.CHUNK if params.effects is None else log.length  # effects with a memory need the whole log
    tally, turning = summary.start(), excitation.start()

    def results() -> Iterator[Filtered]:
        nonlocal tally, turning
        for i, part in enumerate(batch.filter_parts(params, log.facts.first_q, log.parts(size), options), 1):
            tally, turning = summary.add(tally, part), excitation.add(turning, params, part)
            progress(min(i * size / log.length, 1.0))
            yield part

    if keep or choices.smooth or not os.fspath(output).lower().endswith(".npz"):
        filtered = join(list(results()))
        arrays = filtered._asdict()
        if choices.smooth:
            mean, std = batch.smooth_log(likeliest, log.whole(), options)
            arrays |= {"bias_smooth": mean[:, 0], "drift_smooth": mean[:, 1]}
            arrays |= {"bias_smooth_std": std[:, 0], "drift_smooth_std": std[:, 1]}
        save_results(output, arrays, log.start)
    else:
        save_npz_parts(output, (part._asdict() for part in results()))
        assert tally.last is not None  # no log is empty
        filtered = tally.last
    never = [name for name, measured in zip(AXES, log.facts.measured, strict=True) if not measured]
    repairs = log.repairs
    if never:
        repairs = (*repairs, Repair(f"never measured: {' '.join(never)} (bias = prior)", lost=True))
    if hidden := excitation.unobservable(turning):
        what = f"the sensor turns too little: errors of the tool's {' and '.join(hidden)} would look like bias"
        repairs = (*repairs, Repair(what))
    return Outcome(summary.finish(tally), params, repairs, filtered)
