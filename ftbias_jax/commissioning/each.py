"""Diagnosis, or identification of the tool, of many logs one by one."""

from collections.abc import Iterable
from concurrent.futures import Executor
from functools import partial
from typing import Any

from ftbias_jax.calibration.identify_tool import IdentifyResult, identify_tool
from ftbias_jax.diagnosis.diagnose import diagnose
from ftbias_jax.diagnosis.result import Diagnosis
from ftbias_jax.io import GivenLog, GivenMotion, each_of
from ftbias_jax.runtime.many import Results, results_of
from ftbias_jax.setup import GivenSetup, as_setup


def diagnose_each(
    setup: GivenSetup, logs: GivenLog | Iterable[GivenLog], *, executor: Executor | None = None, **choices: Any
) -> Results[Diagnosis]:
    """Diagnose many logs separately, as ``ftbias diagnose LOG... -o FOLDER`` does, not together as ``diagnose``.

    Args:
        setup: nominal setup of the robots, or its path.
        logs: as for ``diagnose``, or their paths; from a list or a generator, taken one at a time.
        executor: executor whose workers diagnose them, as for ``filter_log``.
        choices: arguments of ``diagnose``: without, effects, unchecked.

    Returns:
        a diagnosis for each log in their order, None for one that cannot be diagnosed: ``errors`` has the reason.

    Raises:
        UsageError: there is no log.
    """
    return results_of(partial(diagnose, as_setup(setup), **choices), each_of(logs, executor), executor)


def identify_each(
    setup: GivenSetup, logs: GivenMotion | Iterable[GivenMotion], *, executor: Executor | None = None, **choices: Any
) -> Results[IdentifyResult]:
    """Identify the tool from each of many logs separately, as ``ftbias identify LOG... -o FOLDER`` does.

    Args:
        setup: as for ``identify_tool``.
        logs: as for ``identify_tool``, or their paths; from a list or a generator, taken one at a time.
        executor: executor whose workers identify the tools, as for ``filter_log``.
        choices: arguments of ``identify_tool``: mounting, gravity, bias, crosstalk, unchecked.

    Returns:
        a result for each log in their order, None for one that has none: ``errors`` has the reason.

    Raises:
        UsageError: there is no log.
    """
    return results_of(partial(identify_tool, as_setup(setup), **choices), each_of(logs, executor), executor)
