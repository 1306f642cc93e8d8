"""Effects that explain a log as well as the one that was named."""

from __future__ import annotations

import numpy as np

from ftbias_jax.diagnosis.candidates import Scored
from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.fit import Fit, block_scores, fit
from ftbias_jax.diagnosis.thresholds import ALIKE, CLOSE, FORM_LOSS, HOPELESS, LEAST_DIFFERENCE, MOST_TRIED, MOST_TWINS


def twins_of(problem: Problem, base: Fit, accepted: Fit, cause: Hypothesis, scored: list[Scored]) -> tuple[str, ...]:
    """Effects that could stand in the place of a cause, the others unchanged: at most three, best first.

    That an effect has more free numbers does not count against it here: the data do not separate the two.

    Args:
        problem: of the logs.
        base: the nominal model.
        accepted: all causes together.
        cause: one of them.
        scored: the candidates of the round in which it was found.
    """
    rest = tuple(h for h in accepted.hypotheses if h is not cause)
    named = {h.effect for h in accepted.hypotheses}
    without = fit(problem, rest, accepted) if rest else base
    gain, blocks = accepted.log_likelihood - without.log_likelihood, block_scores(problem, accepted.error)
    left = max(-accepted.log_likelihood - (problem.samples > 0).sum() / 2, 0.0)
    declared = {twin.effect for twin in problem.catalogue[cause.effect].twins}
    twins: dict[str, None] = {}
    hopeful = [s for s in scored if s.hypothesis.effect not in named and s.nats > HOPELESS * scored[0].nats]
    for other in hopeful[:MOST_TRIED]:
        trial = fit(problem, (*rest, other.hypothesis), accepted) if rest else other.fit
        difference = blocks - block_scores(problem, trial.error)
        error = np.sqrt(len(difference)) * difference.std()
        lost = accepted.log_likelihood - trial.log_likelihood
        by_form = FORM_LOSS * gain + left if other.hypothesis.effect in declared else 0.0
        if lost < max(ALIKE * error, LEAST_DIFFERENCE, by_form) and gain - lost > CLOSE * gain:
            twins[other.hypothesis.effect] = None
    return tuple(twins)[:MOST_TWINS]
