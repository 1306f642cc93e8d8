"""One log from file to file: read in parts, filtered, written. What ``ftbias filter`` does for every log."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from ftbias_jax.check.check_setup import check_parts
from ftbias_jax.check.result import Check
from ftbias_jax.filtering.method.ready import ready_to_filter
from ftbias_jax.filtering.noise.log_noise import LogNoise, remark_of_gate
from ftbias_jax.filtering.quality import contacts, observability, summary
from ftbias_jax.filtering.quality.at_rest import weight_in_bias
from ftbias_jax.filtering.quality.observability import remark_of_tool, with_error_of_tool
from ftbias_jax.filtering.quality.summary import Summary
from ftbias_jax.filtering.result import Filtered, join, named_arrays
from ftbias_jax.io.log import Repairs
from ftbias_jax.io.parts import OpenLog
from ftbias_jax.io.write import save_results
from ftbias_jax.io.write.npz import save_npz_parts
from ftbias_jax.io.write.provenance import Provenance, provenance
from ftbias_jax.io.write.selection import ALL, About, Selection, check_selection, selected_parts
from ftbias_jax.model.params import Params
from ftbias_jax.setup.types import Setup


class Outcome(NamedTuple):
    """What came out, beside the file."""

    summary: Summary
    params: Params
    noise: LogNoise
    """What the log shows of contact and noise beyond its setup."""
    repairs: Repairs
    """What was mended or lost, for the owner to know."""
    filtered: Filtered
    """The whole result if it was asked for, otherwise the last part of it."""
    check: Check
    """Mistakes of the setup that the log shows; none if nobody looked."""
    origin: Provenance
    """What the result was made from."""
    worse: bool = False
    """Whether the corrected wrench is worse than the raw one."""


def filter_file(
    log: OpenLog,
    setup: Setup,
    output: str | os.PathLike[str],
    selection: Selection = ALL,
    *,
    smooth: bool = False,
    unchecked: bool = False,
    keep: bool = False,
    progress: Callable[[float], None] = lambda share: None,
    warn: Callable[[str], None] = lambda line: None,
) -> Outcome:
    """Filter a log into a file, which appears whole or not at all.

    A long NPZ log into an NPZ file takes memory for its stamps and for a few chunks; everything else is held whole.

    Args:
        log: opened by ``open_log``.
        setup: of robot, sensor and tool.
        output: the file; its suffix names the format.
        selection: what of the result is written.
        smooth: add the bias given past and future.
        unchecked: do not look first whether the setup can be right.
        keep: also return the result.
        progress: called with the share that is done, 0 to 1.
        warn: called with each mistake of the setup, before anything is computed.

    Raises:
        LogError: the log is damaged. SetupError: the tool is not stated, and the log turns it. OutputError, UsageError:
            the result cannot be written.
    """
    check_selection(selection, smooth=smooth, adapt=setup.bias.adapt)
    setup, of_tool = weight_in_bias(setup, log.parts)
    check = Check(()) if unchecked else check_parts(setup, log.parts, log.length)
    for line in check.lines():
        warn(line)
    ready = ready_to_filter(setup, log.parts, log.length, log.facts.first_q, smooth=smooth)
    tally, turning, touches = summary.start(), observability.start(), contacts.start(ready.noise.contacts)

    def results() -> Iterator[Filtered]:
        nonlocal tally, turning, touches
        done = 0
        for found in ready.results:
            part = with_error_of_tool(found, setup.tool)
            tally, turning = summary.add(tally, part, ready.params.bias), observability.add(turning, ready.params, part)
            touches = contacts.add(touches, ready.noise.contacts, part, log.start)
            done += len(part.t)
            progress(min(done / log.length, 1.0))
            yield part

    bias = setup.bias
    said: dict[str, Any] = {"smooth": smooth, "salvage": log.salvaged, "gate": bias.gate, "adapt": bias.adapt}
    said |= {"tool": "not stated: its weight is part of the bias"} if of_tool else {}
    origin = provenance(setup, [log.source], said)

    def about() -> About:
        return About(log.frame, origin, [x.plain() for x in contacts.finish(touches)], selection)

    if keep or smooth or not os.fspath(output).lower().endswith(".npz"):
        filtered = join(list(results()))
        save_results(output, named_arrays(filtered), about())
    else:
        save_npz_parts(output, selected_parts(map(named_arrays, results()), selection), about)
        assert tally.last is not None  # no log is empty
        filtered = tally.last
    of_filter = (*of_tool, *remark_of_tool(setup.tool), *remark_of_gate(ready.noise))
    repairs = (*log.repairs, *of_filter, *observability.remarks(turning))
    told = summary.finish(tally)
    worse = check.worse_than_raw or summary.worse_than_raw(told)
    return Outcome(told, ready.params, ready.noise, repairs, filtered, check, origin, worse)
