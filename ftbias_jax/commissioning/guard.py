"""Whether what a diagnosis found may be written into a setup: not if that filters the same logs worse."""

from __future__ import annotations

from collections.abc import Sequence

from ftbias_jax.commissioning.judged import Difference, Judged, compare, judge
from ftbias_jax.diagnosis.apply import with_causes
from ftbias_jax.diagnosis.result import Diagnosis
from ftbias_jax.errors import FtbiasError
from ftbias_jax.io.cleaning import clean
from ftbias_jax.io.log import Log
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.setup.types import Setup


@in_float64
def objection(setup: Setup, diagnosis: Diagnosis, logs: Sequence[Log]) -> str:
    """Why a setup with what was found should not be written, and which part of it is the reason; "" = nothing.

    Args:
        setup: that was diagnosed.
        diagnosis: with what it found.
        logs: in which it was found, as ``read_log`` gives them.
    """
    logs = [clean(log) for log in logs]
    setup = setup.with_effects(diagnosis.own_effects)
    causes, terms = diagnosis.causes, diagnosis.terms
    try:
        given = judge(setup, logs, 1.0)
    except FtbiasError:  # with which nothing can be compared
        return ""
    lost = _lost(with_causes(setup, causes, terms), given, logs)
    if lost is None:
        return ""
    if isinstance(lost, FtbiasError):
        return f"the logs cannot be filtered with it: {lost}"
    without = {x.title: with_causes(setup, [other for other in causes if other is not x], terms) for x in causes}
    without |= {x.text: with_causes(setup, causes, [other for other in terms if other is not x]) for x in terms}
    blamed = [name for name, rest in without.items() if _lost(rest, given, logs) is None] if len(without) > 1 else []
    why = f", because of {' and of '.join(blamed)}" if blamed else ""
    return f"the setup with what was found predicts these logs worse{why}: {lost}"


def _lost(setup: Setup, given: Judged, logs: Sequence[Log]) -> Difference | FtbiasError | None:
    """What is lost by a setup in the place of the given one, over whole logs, or why it cannot filter them.

    These are the logs in which it was found: what predicts them worse predicts no other log better.
    """
    try:
        difference = compare(judge(setup, logs, 1.0), given)
    except FtbiasError as error:
        return error
    return difference if difference.is_worse else None
