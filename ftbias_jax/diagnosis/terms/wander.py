"""Bias that wanders more than the setup states: the rest of the gap is slow and follows no drive.

Its size is the noise density sigma_Q of maximum likelihood, axis by axis, of the bias filter on the residual of a fit.
A wandering bias absorbs whatever is slow. But what follows a motion returns with it, whereas integrated white noise (a
double integral) departs ever further with time: what departs less than its density predicts is no bias.
"""

from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.diagnosis import thresholds
from ftbias_jax.diagnosis.evidence.gap import CrossValidation
from ftbias_jax.diagnosis.problem import Part, Problem
from ftbias_jax.diagnosis.regression.fit import Fit, base, fit, predicted
from ftbias_jax.diagnosis.regression.whitening import recursion
from ftbias_jax.diagnosis.result import WANDER, FoundTerm
from ftbias_jax.diagnosis.terms.select import Search
from ftbias_jax.filtering.noise.wander import departures, goes_far, most_likely
from ftbias_jax.types import AXES, AXIS_UNITS

FACTORS = 2.0 ** np.arange(20)
"""Candidate densities, as multiples of the stated ones."""
LEAST_DENSITY = 1e-5
"""1/s^1.5: smallest reference density in standard deviations of a sample, where less or nothing is stated."""
ROUNDS = 4
"""Alternating estimates of the density and of the effects' parameters."""


class Wander(NamedTuple):
    """Noise density of the bias drift beside a fit."""

    density: np.ndarray
    """(6,) N/s^1.5, Nm/s^1.5; as stated on axes without an increase."""
    stderr: np.ndarray
    """(6,) standard error; 0 on these axes."""
    stated: np.ndarray
    """(6,) stated density."""
    nats: float
    """Gain over the fit with the stated density, after the penalty for the parameters."""
    nats_stderr: float


def wander_of(problem: Problem, found: Fit) -> Wander | None:
    """Density of a wandering bias that explains the residual of a fit; None if not certainly above the stated one.

    With another density, other parameters of the same effects are likeliest and leave another bias.
    """
    if any(part.wrench.jump is not None for part in problem.parts):
        return None
    stated = np.asarray(problem.parts[0].wrench.density)
    densities = np.vstack([stated, FACTORS[:, None] * np.maximum(stated, LEAST_DENSITY * problem.noise_std)])
    left = _left(problem, found)
    first = nats = _nats(problem, left, densities)
    octave, stderr, wanders = _octaves(nats)
    for _ in range(ROUNDS - 1 if found.hypotheses else 0):
        wide = problem.wandering(np.where(wanders, densities[1] * 2.0**octave, stated))
        left = _left(wide, fit(wide, found.hypotheses, base(wide)))
        nats = _nats(problem, left, densities)
        octave, stderr, wanders = _octaves(nats)
    density = densities[1] * 2.0**octave
    wanders = goes_far(wanders, _went(problem, left, density))
    if not wanders.any():
        return None
    row = np.where(wanders, 1 + np.rint(octave).astype(int), 0)
    gains = np.bincount(problem.block(thresholds.BLOCK_SECONDS), (nats[:, row, range(6)] - first[:, 0]).sum(1))
    gain, error = gains.sum() - thresholds.PENALTY_PER_PARAMETER * wanders.sum(), np.sqrt(len(gains)) * gains.std()
    if gain < max(thresholds.LEAST_GAIN, thresholds.SURE * error):
        return None
    errors = np.where(wanders, np.log(2) * stderr * density, 0.0)
    return Wander(np.where(wanders, density, stated), errors, stated, float(gain), float(error))


def _left(problem: Problem, found: Fit) -> list[np.ndarray]:
    """Residual of a fit for each log, (U, 6) N, Nm: bias and noise; NaN = not measured."""
    ends = np.cumsum([part.used for part in problem.parts])[:-1]
    pairs = zip(problem.parts, np.split(predicted(problem, found), ends), strict=True)
    return [reading - np.asarray(part.wrench.wrench)[: part.used] for part, reading in pairs]


def _nats(problem: Problem, left: list[np.ndarray], densities: np.ndarray) -> np.ndarray:
    """(U, G, 6) log-likelihood in nats of every bin of the residual, for G densities (G, 6)."""
    pairs = zip(problem.parts, left, strict=True)
    return np.concatenate([_of_log(part, y, densities) for part, y in pairs])


def _of_log(part: Part, left: np.ndarray, densities: np.ndarray) -> np.ndarray:
    """Log-likelihood of one log: the bias filter with all densities side by side."""
    wrench, count = part.wrench, len(densities)
    y, variance = (np.asarray(x)[: part.used] for x in (wrench.wrench, wrench.variance))
    prior = np.tile(np.asarray(wrench.prior_std).reshape(2, 6), count).ravel()
    tiled: dict[str, Any] = {"wrench": np.tile(y, count), "variance": np.tile(variance, count), "prior_std": prior}
    gains, weight = recursion(wrench._replace(**tiled, density=densities.ravel()), part.used)  # type: ignore[arg-type]
    measured, dt = np.tile(np.nan_to_num(left), count), np.asarray(wrench.dt)
    bias, drift = np.zeros((2, 6 * count))
    nats = np.zeros_like(weight)
    for k in range(part.used):
        bias = bias + dt[k] * drift
        innovation = measured[k] - bias
        bias, drift = bias + gains[k, 0] * innovation, drift + gains[k, 1] * innovation
        nats[k] = np.log(np.where(weight[k] > 0, weight[k], 1)) - (innovation * weight[k]) ** 2 / 2
    return nats.reshape(part.used, count, 6)


def _octaves(nats: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Octave (6,) of the likeliest factor, its standard error, and whether the gain is worth the penalty.

    From nats (U, 1 + factors, 6), the first of which belong to the stated density.
    """
    stated, *tried = nats.sum(0)
    return *most_likely(np.array(tried)), np.max(tried, 0) - stated > thresholds.PENALTY_PER_PARAMETER


def _went(problem: Problem, left: list[np.ndarray], density: np.ndarray) -> np.ndarray:
    """Mean square departure (6,) of the bias from a straight line, relative to that expected with this density.

    Noise of samples and errors of the joints average out in the means of blocks.
    """
    seen, expected = np.zeros((2, 6))
    for part, y in zip(problem.parts, left, strict=True):
        t = np.asarray(part.signals.t)[: part.used]
        block, there = (t // thresholds.BLOCK_SECONDS).astype(int), np.isfinite(y)
        count = np.stack([np.bincount(block, x) for x in there.T], 1)
        total = np.stack([np.bincount(block, x) for x in np.where(there, y, 0).T], 1)
        level = np.where(count > 0, total / np.maximum(count, 1), np.nan)
        middle = np.bincount(block, t) / np.maximum(np.bincount(block), 1)
        of_log = departures(middle, level, np.zeros_like(level))
        seen, expected = (x + len(t) * y for x, y in zip((seen, expected), of_log, strict=True))
    return seen / np.maximum(expected * density**2, 1e-300)


def is_all(wander: Wander, problem: Problem, nominal: Fit, accepted: Fit, hold_out: CrossValidation) -> bool:
    """Whether no term gains much in addition to a fit of the problem with the wandering bias."""
    best = Search(problem, nominal, hold_out).best(accepted)
    return not best or best[0][0] < max(thresholds.LEAST_GAIN, thresholds.NEARLY * wander.nats)


def wander_term(wander: Wander, duration: float, share: float) -> FoundTerm:
    """Term by which a wandering bias is reported, for logs of this duration in s, with its share of the gap."""
    more = wander.stderr > 0
    most = int(np.argmax(np.where(more, wander.density / np.maximum(wander.stated, 1e-300), 0)))
    axes = "all axes" if more.all() else ", ".join(name for name, marked in zip(AXES, more, strict=True) if marked)
    size, stated = f"{wander.density[most]:.2g} {AXIS_UNITS[most]}/s^1.5", f"{wander.stated[most]:.2g}"
    units = {"N_per_s1.5": slice(0, 3), "Nm_per_s1.5": slice(3, 6)}
    return FoundTerm(
        drive="noise",
        form=WANDER,
        frame="sensor",
        acts_as="bias",
        text=f"a bias that wanders more than the setup states, on {axes}: bias.noise_density {size} "
        f"({AXES[most]}, where it departs most) instead of {stated} ({100 * share:.0f} % of the gap)",
        coefficients={unit: wander.density[axis].tolist() for unit, axis in units.items()},
        stderr={unit: wander.stderr[axis].tolist() for unit, axis in units.items()},
        parameters={},
        parameters_stderr={},
        point=None,
        equivalent_to=(),
        separate_by=(),
        resembles=("a sensor that is not warm yet", "a noise_density that was never measured"),
        check="let the sensor warm up and record again",
        held_out_gain=wander.nats / duration,
        held_out_gain_stderr=wander.nats_stderr / duration,
        shrink=share,
        section={"noise_density": wander.density.tolist()},
        statement=f"the bias wanders more than stated (noise_density {size} of {AXES[most]}, not {stated})",
    )
