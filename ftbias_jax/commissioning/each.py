"""The verbs of many logs, each by itself: diagnosed, or asked for its tool."""

import os
from collections.abc import Iterable, Mapping
from concurrent.futures import Executor
from functools import partial
from pathlib import Path
from typing import Any

from ftbias_jax.calibration.identify_tool import IdentifyResult, identify_tool
from ftbias_jax.diagnosis.diagnose import diagnose
from ftbias_jax.diagnosis.result import Diagnosis
from ftbias_jax.io import read_log, read_motion
from ftbias_jax.io.log import Log, as_list
from ftbias_jax.io.remote import from_anywhere
from ftbias_jax.io.tables.poses import Poses
from ftbias_jax.runtime.many import Results, results_of
from ftbias_jax.setup.types import Setup

Source = Log | Poses | str | os.PathLike[str]
"""A log, static poses, or the path of either."""


def diagnose_each(
    setup: Setup, logs: Iterable[Log | str | os.PathLike[str]], *, executor: Executor | None = None, **choices: Any
) -> Results[Diagnosis]:
    """Diagnose many logs, each by itself, as ``ftbias diagnose LOG... -o FOLDER`` does, not together as ``diagnose``.

    Args:
        setup: what the robots' owner believes.
        logs: as of ``diagnose``, or their paths; from a list or a generator, taken one at a time.
        executor: whose workers diagnose them, as of ``filter_log``.
        choices: arguments of ``diagnose``: without, effects, unchecked.

    Returns:
        a diagnosis for each log in their order, None for one that cannot be diagnosed: ``errors`` says why.

    Raises:
        UsageError: there is no log.
    """
    return results_of(partial(_diagnosed, setup, choices), _given(logs, executor), executor)


def identify_each(
    setup: Setup, logs: Iterable[Source], *, executor: Executor | None = None, **choices: Any
) -> Results[IdentifyResult]:
    """Find the tool that each of many logs shows by itself, as ``ftbias identify LOG... -o FOLDER`` does.

    Args:
        setup: as of ``identify_tool``.
        logs: as of ``identify_tool``, or their paths; from a list or a generator, taken one at a time.
        executor: whose workers do it, as of ``filter_log``.
        choices: arguments of ``identify_tool``: mounting, gravity, bias, crosstalk, unchecked.

    Returns:
        a result for each log in their order, None for one that has none: ``errors`` says why.

    Raises:
        UsageError: there is no log.
    """
    return results_of(partial(_identified, setup, choices), _given(logs, executor), executor)


def _given(logs: Iterable[Source], executor: Executor | None) -> Iterable[Source]:
    """What is to be done, of one log alone a list of it, as workers elsewhere find it."""
    logs = as_list(logs)
    return map(from_anywhere, logs) if executor else logs


def _diagnosed(setup: Setup, choices: Mapping[str, Any], source: Log | str | os.PathLike[str]) -> Diagnosis:
    if isinstance(source, Log):
        return diagnose(setup, [source], **choices)
    return diagnose(setup, [read_log(source, setup, raw=True)], [Path(source).name], **choices)


def _identified(setup: Setup, choices: Mapping[str, Any], source: Source) -> IdentifyResult:
    log = source if isinstance(source, Log | Poses) else read_motion(source, setup)
    return identify_tool(setup, log, **choices)
