"""Noise whose variance follows a drive, judged on individual samples by held-out likelihood against constant noise."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis import thresholds
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.result import FoundTerm
from ftbias_jax.diagnosis.samples.noise import WINDOW, fast_waves
from ftbias_jax.diagnosis.samples.types import Finding, SampleFindings
from ftbias_jax.diagnosis.samples.variance_fit import average_runs, blocks_of, judge_variance, standard_errors
from ftbias_jax.diagnosis.terms.found import found_term
from ftbias_jax.diagnosis.terms.grid import make_term
from ftbias_jax.diagnosis.terms.phrases import FORM_WORDS
from ftbias_jax.io.log import Log
from ftbias_jax.model.effects.fitting import GROWTH
from ftbias_jax.model.effects.terms.columns import columns, noise_variance
from ftbias_jax.model.effects.terms.forms import FORMS
from ftbias_jax.model.effects.terms.types import State

FORMS_OF_NOISE = tuple(name for drive, name in FORMS if drive == "noise")
OF_MOTION = ("speed", "joints")
"""Forms that the catalogue's effect of noise growing with speed describes better."""
MOST_ROWS = 4096
"""Longer logs are averaged over runs of samples, within which no drive changes much."""


class Growing(NamedTuple):
    """One form of growth, fitted to the variance of each channel."""

    form: str
    weight: np.ndarray
    """(2, 6) N^2, Nm^2: variance at zero, and per unit of the form."""
    stderr: np.ndarray
    """(2, 6)."""
    nats: float
    """Gain over constant noise on held-out blocks."""
    nats_stderr: float
    visible: float
    """Ratio of standard deviations in the loudest and quietest tenths of the log, in the channel that grows most."""


def noise_term(
    problem: Problem, logs: Sequence[Log], samples: Sequence[SampleFindings], state: State, found: Collection[Finding]
) -> FoundTerm | None:
    """Noise term of the longest log, if it is significant and no effect of the catalogue describes it."""
    longest = int(np.argmax(problem.durations))
    growing = _best(problem, logs[longest], samples[longest], state, longest)
    # Many forms and channels are tried, so the best one reaches two standard errors by chance in 1 of 50 logs.
    if growing is None or growing.nats < max(thresholds.GROWTH_NATS, thresholds.BEYOND_CHANCE * growing.nats_stderr):
        return None
    of_speed = next((finding.nats for finding in found if finding.sign == GROWTH), 0.0)
    said = growing.nats < thresholds.NOISE_BETTER * of_speed or (of_speed and growing.form in OF_MOTION)
    if said or growing.visible < thresholds.GROWTH_VISIBLE:
        return None
    return _as_found_term(growing, problem.durations[longest])


def _best(problem: Problem, log: Log, samples: SampleFindings, state: State, number: int) -> Growing | None:
    rows = np.isfinite(samples.clean_wrench).all(1)
    t = np.asarray(log.t, float)[rows]
    if len(t) < thresholds.TERM_WINDOWS * WINDOW or samples.jitter.detected or samples.heavy_tailed:
        return None
    waves = fast_waves(t, samples.clean_wrench[rows])
    when = t[waves.row.reshape(-1)]
    run = -(-len(when) // MOST_ROWS)
    when, squares = average_runs(when, run), average_runs(waves.top_squares, run)
    own = problem.log == number
    drives = {}
    for form in FORMS_OF_NOISE:
        whole = columns(np, make_term("noise", form, "sensor", "noise"), state)
        drives[form] = np.stack([np.interp(when, problem.t[own], whole[own, k, k]) for k in range(6)], 1)
    scores = {form: run * _score(drive, squares) for form, drive in drives.items()}
    hopeful = sorted((form for form in scores if scores[form] > thresholds.GROWTH_NATS), key=lambda form: -scores[form])
    block = blocks_of(when)
    found = [_fitted(form, drives[form], squares, block, run) for form in hopeful[: thresholds.NOISE_FORMS_FITTED]]
    return max(found, key=lambda growing: growing.nats, default=None)


def _score(drive: np.ndarray, squares: np.ndarray) -> float:
    """nats that a small share of a drive (N, 6) gains over a constant: the score test of Gaussian noise."""
    apart = drive - drive.mean(0)
    surplus = np.minimum(squares / squares.mean(0), thresholds.FAR_SQUARES) - 1
    along = np.maximum((surplus * apart).sum(0), 0)
    return float((along**2 / np.maximum(4 * (apart**2).sum(0), 1e-300)).sum())


def _fitted(form: str, drive: np.ndarray, squares: np.ndarray, block: np.ndarray, run: int) -> Growing:
    """Constant and one nonnegative drive (N, 6), fitted channel by channel."""
    weight, stderr = np.zeros((2, 2, 6))
    gains = np.zeros((block.max() + 1, 6))
    visible = np.ones(6)
    for k in range(6):
        own = squares[:, [k]]
        if drive[:, k].max() <= 0 or not (found := judge_variance(drive[:, k], own, block, run)).better[0]:
            continue
        gains[:, k], weight[:, k] = found.nats, found.weights[:, 0]
        stderr[:, k] = standard_errors(found.design, own, found.weights, block)[0][:, 0]
        variance = np.sort(found.design @ found.weights[:, 0])
        tenth = max(len(variance) // 10, 1)
        visible[k] = np.sqrt(variance[-tenth:].mean() / variance[:tenth].mean())
    total = gains.sum(1)
    return Growing(form, weight, stderr, total.sum(), np.sqrt(len(total)) * total.std(), float(visible.max()))


def louder(problem: Problem, term: FoundTerm, state: State) -> Problem:
    """Problem with the variance that a term adds to the noise of its bins."""
    own = replace(make_term("noise", term.form, "sensor", "noise"), coefficients=term.section["coefficients"])
    return problem.louder(noise_variance(np, {"noise": own}, state) / np.maximum(problem.samples, 1))


def _as_found_term(growing: Growing, duration: float) -> FoundTerm:
    term = replace(make_term("noise", growing.form, "sensor", "noise"), coefficients=growing.weight[1])
    does, visible = FORM_WORDS["noise", growing.form], f"{growing.visible:.2g} times"
    text = f"noise whose variance grows {does}: it is up to {visible} as loud as where it is least"
    gain = (growing.nats / max(duration, 1e-9), growing.nats_stderr / max(duration, 1e-9))
    return found_term(term, growing.stderr[1], text, f"noise grows {does}, up to {visible}", gain)
