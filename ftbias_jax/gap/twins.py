"""Effects that explain a log as well as the one that was named."""

from __future__ import annotations

import numpy as np

from ftbias_jax.gap.candidates import Scored
from ftbias_jax.gap.fit import Fit, block_scores, fit
from ftbias_jax.gap.hypotheses import Hypothesis
from ftbias_jax.gap.problem import Problem

SAME = 3.0
"""Standard errors of the comparison within which two explanations are as good as one another."""
CLOSE = 0.95
"""Share of the gain that a twin must reach."""
LEAST_DIFFERENCE = 6.0
"""nats that decide, whatever the standard error."""
MOST_TWINS = 3
MOST_TRIED = 5


def twins_of(problem: Problem, base: Fit, accepted: Fit, cause: Hypothesis, scored: list[Scored]) -> tuple[str, ...]:
    """Effects that could stand in the place of a cause, the others unchanged: at most three, best first.

    That an effect has more free numbers does not count against it here: the data do not separate the two.

    Args:
        problem: of the logs. base: the believed model. accepted: all causes together. cause: one of them.
        scored: the candidates of the round in which it was found.
    """
    rest = tuple(h for h in accepted.hypotheses if h is not cause)
    named = {h.effect for h in accepted.hypotheses}
    without = fit(problem, rest, accepted) if rest else base
    gain, blocks = accepted.log_likelihood - without.log_likelihood, block_scores(problem, accepted)
    twins: dict[str, None] = {}
    for other in [s for s in scored if s.hypothesis.effect not in named][:MOST_TRIED]:
        trial = fit(problem, (*rest, other.hypothesis), accepted) if rest else other.fit
        difference = blocks - block_scores(problem, trial)
        error = np.sqrt(len(difference)) * difference.std()
        lost = accepted.log_likelihood - trial.log_likelihood
        if lost < max(SAME * error, LEAST_DIFFERENCE) and gain - lost > CLOSE * gain:
            twins[other.hypothesis.effect] = None
    return tuple(twins)[:MOST_TWINS]
