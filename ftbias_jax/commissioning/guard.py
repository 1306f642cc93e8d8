"""Whether what a diagnosis found may be written into a setup: not if that filters the same logs worse."""

from __future__ import annotations

from collections.abc import Sequence

from ftbias_jax.commissioning.judged import cost_of
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
        lost = cost_of(with_causes(setup, causes, terms), setup, logs)
    except FtbiasError as error:
        return f"the logs cannot be filtered with it: {error}"
    if lost is None:
        return ""
    without = {x.title: with_causes(setup, [other for other in causes if other is not x], terms) for x in causes}
    without |= {x.text: with_causes(setup, causes, [other for other in terms if other is not x]) for x in terms}
    blamed = [name for name, rest in without.items() if _costs_nothing(setup, rest, logs)]
    why = f", because of {' and of '.join(blamed)}" if blamed and len(without) > 1 else ""
    return f"the setup with what was found predicts these logs worse{why}: {lost}"


def _costs_nothing(setup: Setup, other: Setup, logs: Sequence[Log]) -> bool:
    try:
        return cost_of(other, setup, logs) is None
    except FtbiasError:
        return False
