"""Changes of the bias: settling, temperature and jumps, their times and time constants refined."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np

from ftbias_jax.diagnosis import hypothesis as hyp
from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.dictionary import Found, Library, alike, by_channel
from ftbias_jax.diagnosis.regression.fit import Fit

RAMPS = (0.15, 0.3, 0.6, 1.2, 2.4)
"""s that a jump may take."""
LEAST_OF_RAMP = 12.0
"""nats that it must gain over a sudden one."""
FINE = 17
"""Values tried at every refinement of a time or a time constant."""


def slow(problem: Problem, library: Library, accepted: Fit, taken: Collection[str]) -> list[Found]:
    """Warm-up and temperature, the time constant of each refined."""
    gain = by_channel(accepted, library.slow_white)
    best: dict[str, Found] = {}
    for found in zip(gain.tolist(), library.slow, strict=True):
        if found[1].effect not in taken and found[0] > best.get(found[1].effect, (-np.inf,))[0]:
            best[found[1].effect] = found
    return [_with_time_constant(problem, accepted, found) for found in best.values()]


def _with_time_constant(problem: Problem, accepted: Fit, found: Found) -> Found:
    """The best time constant near that of a slow series; without a lag it stays as it is."""
    _, h = found
    if not h.detail[0]:
        return found
    ratio = float(np.log(hyp.TIME_CONSTANTS[1] / hyp.TIME_CONSTANTS[0]))

    def make(log_time: np.ndarray) -> list[Hypothesis]:
        return [hyp.retimed(problem, h, float(time)) for time in np.exp(log_time)]

    return refine(problem, accepted, make, float(np.log(h.detail[0])), ratio)


def jump(problem: Problem, library: Library, accepted: Fit, taken: Collection[str]) -> list[Found]:
    """The jump of the bias that gains most, its time refined, sudden or along a straight line."""
    if "bias_jump" in taken or not library.jumps:
        return []
    best = library.jumps[int(by_channel(accepted, library.jumps_white).argmax())]
    when, log, _ = best.detail

    def make(times: np.ndarray) -> list[Hypothesis]:
        return hyp.jumps(problem, int(log), times)

    step = max(hyp.JUMP_STEP, problem.durations[int(log)] / 400)
    sudden = refine(problem, accepted, make, when, step)
    middle = sudden[1].detail[0]
    ramps = [
        h for ramp in RAMPS for h in hyp.jumps(problem, int(log), middle + ramp * np.linspace(-0.9, -0.1, 9), ramp)
    ]
    gain = by_channel(accepted, alike(problem, [h.shapes[0] for h in ramps]))
    slower = float(gain.max()), ramps[int(gain.argmax())]
    return [slower if slower[0] > sudden[0] + LEAST_OF_RAMP else sudden]


def refine(
    problem: Problem, accepted: Fit, make: Callable[[np.ndarray], list[Hypothesis]], at: float, reach: float
) -> Found:
    """The best of ever finer grids around a value that a series depends on.

    Args:
        problem: the logs.
        accepted: the fit of the causes found so far.
        make: values -> one hypothesis each.
        at: the best so far.
        reach: how far from it the best may be.
    """
    for _ in range(2):
        values = at + reach * np.linspace(-1, 1, FINE)
        made = make(values)
        gain = by_channel(accepted, alike(problem, [h.shapes[0] for h in made]))
        best = int(gain.argmax())
        at, reach = float(values[best]), 2 * reach / (FINE - 1)
    return float(gain[best]), made[best]
