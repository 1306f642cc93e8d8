"""One log from file to file: read in parts, filtered, written. What ``ftbias filter`` does for every log."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator

from ftbias_jax.filtering.result import Filtered, named_arrays
from ftbias_jax.filtering.verbs.from_setup import filter_one
from ftbias_jax.filtering.verbs.results import FilterResult
from ftbias_jax.io.parts import OpenLog
from ftbias_jax.io.write.npz import save_npz_parts
from ftbias_jax.io.write.selection import ALL, About, Selection, check_selection, selected_parts
from ftbias_jax.setup.types import Setup


def filter_file(
    log: OpenLog,
    setup: Setup,
    output: str | os.PathLike[str],
    selection: Selection = ALL,
    *,
    smooth: bool = False,
    unchecked: bool = False,
    keep: bool = False,
    progress: Callable[[int], None] = lambda samples: None,
    warn: Callable[[str], None] = lambda line: None,
) -> FilterResult:
    """Filter a log into a file, which appears whole or not at all; further arguments as ``filter_one``.

    A long NPZ log into an NPZ file takes memory for its stamps and for a few chunks; everything else is held whole.

    Args:
        log: opened by ``open_log``.
        setup: of robot, sensor and tool.
        output: the file; its suffix names the format.
        selection: what of the result is written.
        smooth: add the bias given past and future.
        unchecked: do not look first whether the setup can be right.
        keep: the result has all arrays; otherwise they may be those of the last part.
        progress: called with the number of samples done so far.
        warn: called with each mistake of the setup, before anything is computed.

    Raises:
        LogError: the log is damaged. SetupError: the tool is not stated, and the log turns it. OutputError, UsageError:
            the result cannot be written.
    """
    check_selection(selection, smooth=smooth, adapt=setup.bias.adapt)

    def write(parts: Iterator[Filtered], about: Callable[[], About]) -> None:
        chosen = selected_parts(map(named_arrays, parts), selection)
        save_npz_parts(output, chosen, lambda: about()._replace(selection=selection))

    whole = keep or smooth or not os.fspath(output).lower().endswith(".npz")
    sink = None if whole else write
    result = filter_one(setup, log, smooth=smooth, unchecked=unchecked, progress=progress, warn=warn, write=sink)
    if whole:
        result.save(output, **selection._asdict())
    return result
