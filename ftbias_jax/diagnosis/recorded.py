"""What logs have beside joints and wrench, and which effects they cannot speak about."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from ftbias_jax.diagnosis.regression.coordinates import why_not_fitted
from ftbias_jax.io.log import Log
from ftbias_jax.model.effects.table import Catalogue
from ftbias_jax.model.shown import not_shown
from ftbias_jax.setup.types import Setup


def recorded_in(logs: Sequence[Log]) -> frozenset[str]:
    """What effects may need beside joints and wrench: "temperature" if a log has it, and columns that all have."""
    warm = {"temperature"} if any(np.isfinite(log.temperature).any() for log in logs) else set()
    return frozenset(warm).union(set(logs[0].columns).intersection(*(log.columns for log in logs)))


def not_tested(
    setup: Setup, catalogue: Catalogue, recorded: Collection[str], without: Collection[str]
) -> tuple[tuple[str, str], ...]:
    """(effect, why) of those that the logs are not asked about.

    Args:
        setup: of the diagnosis.
        catalogue: the effects that could be looked for.
        recorded: as of ``recorded_in``.
        without: effects that the caller left out.
    """
    reasons = [(name, "left out on request") for name in without]
    reasons += [(name, "the setup has it already") for name in setup.effects]
    reasons += [(name, reason) for name, reason in not_shown(setup).items() if name not in without]
    for name, effect in catalogue.items():
        reasons += [(name, f"no {need} was recorded") for need in effect.needs if need not in recorded]
    for effect in catalogue.own:
        reasons += [(effect.name, reason) for reason in [why_not_fitted(effect)] if reason]
    return tuple(reasons)
