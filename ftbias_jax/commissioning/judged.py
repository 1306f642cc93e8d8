"""How well a setup predicts the held-out end of logs, and whether one setup predicts better than another.

The findings of a diagnosis may not be written into a setup if it then predicts the same logs worse.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.calibration.judgement import HORIZONS, SEGMENTS, SURE, errors_of_constant_bias, prediction_errors
from ftbias_jax.diagnosis.apply import with_causes
from ftbias_jax.diagnosis.result import Diagnosis
from ftbias_jax.errors import FtbiasError
from ftbias_jax.filtering.samples import settled_at
from ftbias_jax.filtering.verbs.from_setup import filter_log
from ftbias_jax.filtering.verbs.results import FilterResult
from ftbias_jax.io.cleaning import clean
from ftbias_jax.io.log import Log
from ftbias_jax.model.effects.statements import value_words
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.runtime.kept_programs import compiled_for_few_calls
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import AXES, Array

MATTERS = 0.01
"""Smallest relative change of the errors that counts."""
SAME = 1e-9
"""Relative change of the errors that is only rounding."""
FEWER = 0.03
"""Share of the samples that a better setup may leave out beyond those that the other one leaves out."""
MORE = 0.2
"""Share of the samples beyond those of the other setup from which using them is better, if nothing is worse: a filter
that takes the motion of a wrong tool for contact predicts the rest, at rest, as well as a right one."""
LEAST_INSIDE = 0.85
"""Share of readings in their 95 % intervals: a setup with fewer, and fewer than the other one, is not better."""
WITHIN = 1.96
"""Half-width of a 95 % interval in standard deviations."""
TARE = 0.5
"""s at the start of a log whose mean is a held tare."""
SETUPS = 6
"""Approximate number of setups that are judged from a draft to its calibration."""
HELD_TARE, CONSTANT = f"tare of the first {TARE} s", "constant bias"
"""Names of predictions that need no filter."""


class Judged(NamedTuple):
    """Prediction errors of a setup on the held-out end of logs; T samples of all of them, H horizons."""

    errors: Array
    """(H, T, 6) N, Nm: the reading minus its prediction at each horizon; NaN = not used or not predicted."""
    inside: Array
    """(H, T, 6) 1 where the reading is in its predicted 95 % interval, 0 where not, NaN = not used."""
    used: Array
    """(T,) 1 where the filter used the sample, 0 where not, NaN = useless because of the setup's effects."""
    stretch: Array
    """(T,) index of the segment of a log."""
    constant: Array
    """(2, T, 6) N, Nm: the reading minus the tool's wrench and a bias that needs no filter, of HELD_TARE and of
    CONSTANT; NaN = not used."""
    tool_error: Array
    """(L,) relative error of the tool's force in each of the logs, as the filter reports it; 0 = none."""

    @property
    def rms(self) -> Array:
        """(H, 6) N, Nm; NaN = nothing was predicted."""
        return _rms(self.errors)

    @property
    def coverage(self) -> Array:
        """(H, 6) share of the readings in their 95 % intervals; NaN = nothing was predicted."""
        return _mean(self.inside)


class Difference(NamedTuple):
    """How much smaller the errors of one setup are than those of another."""

    share: float
    """Mean over axes and horizons of the log ratio of their rms errors; negative = smaller."""
    stderr: float
    fewer: float
    """Share of the samples that only the other setup uses."""
    misses: bool
    """Whether its intervals hold fewer readings than the other's, and fewer than LEAST_INSIDE."""

    @property
    def is_better(self) -> bool:
        """Whether the errors are smaller by more than chance, or far more samples are used, and nothing is worse."""
        smaller = self.share < -max(MATTERS, SURE * self.stderr)
        return (smaller or self.fewer < -MORE) and not self.is_worse

    @property
    def is_worse(self) -> bool:
        """Whether the errors are larger by more than chance, or something else is worse."""
        return self.share > max(MATTERS, SURE * self.stderr) or bool(self.costs)

    @property
    def costs(self) -> str:
        """What is worse besides the errors, in words; "" = nothing."""
        fewer = f"{100 * self.fewer:.0f} % fewer samples used" if self.fewer > FEWER else ""
        return "; ".join(x for x in (fewer, "too few readings in their intervals" if self.misses else "") if x)

    def __str__(self) -> str:
        ratio = np.exp(self.share)
        change = value_words(100 * abs(ratio - 1), 100 * ratio * self.stderr)
        same = abs(self.share) < SAME
        words = "errors as before" if same else f"errors {change} % {'smaller' if ratio < 1 else 'larger'}"
        more = f"{-100 * self.fewer:.0f} % more samples used" if self.fewer < -MORE else ""
        return "; ".join(x for x in (words, more, self.costs) if x)


def judge(setup: Setup, logs: Sequence[Log], hold_out: float) -> Judged:
    """Filter whole logs, and compute the prediction errors at their ends.

    Args:
        setup: setup to filter with.
        logs: logs as returned by ``read_log``.
        hold_out: share at the end of each log that counts.
    """
    with compiled_for_few_calls(SETUPS * sum(len(log.t) for log in logs)):
        return _joined([_of_end(filter_log(setup, log, unchecked=True), log, hold_out) for log in logs])


def baselines(judged: Judged) -> dict[str, Judged]:
    """Errors without a filter, with a setup's tool: of a bias held from the start, or its mean over the fitted part."""
    unknown = np.full_like(judged.inside, np.nan)
    return {
        name: judged._replace(errors=np.stack([errors] * len(HORIZONS)), inside=unknown)
        for name, errors in zip((HELD_TARE, CONSTANT), judged.constant, strict=True)
    }


def compare(new: Judged, old: Judged) -> Difference:
    """Compare the errors of two setups at the samples that both used.

    The standard error is a jackknife over segments of the logs, within which errors are correlated.

    Args:
        new: errors of the setup that may be accepted.
        old: errors of the setup before it.
    """
    both = np.isfinite(new.errors) & np.isfinite(old.errors)

    def share(left_out: int) -> float:
        rows = both & (new.stretch != left_out)[None, :, None]
        ours, theirs = (_rms(np.where(rows, x.errors, np.nan)) for x in (new, old))
        known = (ours > 0) & (theirs > 0)
        return float(np.log(ours[known] / theirs[known]).mean()) if known.any() else 0.0

    numbers = np.unique(new.stretch)
    stderr = float(np.sqrt((len(numbers) - 1) * np.var([share(number) for number in numbers])))
    inside, before = (np.nanmean(x.inside) if np.isfinite(x.inside).any() else 1.0 for x in (new, old))
    misses = bool(inside < min(LEAST_INSIDE, before))
    return Difference(share(-1), stderr, _mean((old.used - new.used)[:, None]).item(), misses)


def table(rows: dict[str, Judged]) -> list[tuple[str, ...]]:
    """Name, seconds ahead, root mean square errors of the six axes, coverage and samples used; a row for each horizon.

    Args:
        rows: errors to compare, by name.
    """
    return [
        (
            name,
            f"{seconds:g} s",
            *(f"{x:.3g}" if np.isfinite(x) else "-" for x in judged.rms[i]),
            "" if not np.isfinite(judged.inside[i]).any() else f"{100 * np.nanmean(judged.inside[i]):.0f} %",
            "" if i else f"{100 * np.nanmean(judged.used):.0f} %",
        )
        for i, seconds in enumerate(HORIZONS)
        for name, judged in rows.items()
    ]


HEAD = ("unseen end, rms in N, Nm", "ahead", *AXES, "in 95 %", "used")
"""Header of ``table``."""


@in_float64
def objection(setup: Setup, diagnosis: Diagnosis, logs: Sequence[Log]) -> str:
    """Why a setup with the findings should not be written, and which of them are the reason; "" = no objection.

    Args:
        setup: setup that was diagnosed.
        diagnosis: diagnosis with the findings.
        logs: logs that were diagnosed, as returned by ``read_log``.
    """
    logs = [clean(log) for log in logs]
    setup = setup.with_effects(diagnosis.own_effects)
    causes, terms = diagnosis.causes, diagnosis.terms
    try:
        given = judge(setup, logs, 1.0)
    except FtbiasError:  # nothing can be compared with it
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
    """How much worse a setup is than the given one over whole logs, or why it cannot filter them; None = not worse.

    These are the logs of the diagnosis: a setup that predicts them worse predicts no other log better.
    """
    try:
        difference = compare(judge(setup, logs, 1.0), given)
    except FtbiasError as error:
        return error
    return difference if difference.is_worse else None


def _errors(result: FilterResult) -> tuple[Array, Array]:
    """(H, T, 6) prediction errors, and whether the readings are in their intervals."""
    found = [(prediction_errors(result, result.params.bias, ahead), _std_ahead(result, ahead)) for ahead in HORIZONS]
    errors, std = (np.stack(parts) for parts in zip(*found, strict=True))
    return errors, np.where(np.isfinite(errors), np.abs(errors) < WITHIN * std, np.nan)


def _std_ahead(result: FilterResult, seconds: float) -> Array:
    """(T, 6) N, Nm: standard deviation of the error of predicting each reading ``seconds`` before it."""
    past = np.searchsorted(result.t, result.t - seconds, side="right") - 1
    variance = result.forecast(seconds).std[past] ** 2
    if result.reading_std is not None:
        # The noise due to motion is that at the reading, because the motion of the arm is known beforehand.
        variance += result.reading_std**2 - result.reading_std[past] ** 2
    return np.sqrt(variance)


def _of_end(result: FilterResult, log: Log, hold_out: float) -> Judged:
    """Errors at the end of a log, at all stamps of its wrench; the result lacks those that the setup makes useless."""
    t = log.t[np.isfinite(log.wrench).any(1)] + log.start
    begin = float(t[-1] - hold_out * (t[-1] - t[0]))
    rows, places = t >= begin, np.searchsorted(t, result.t)

    def at_stamps(values: Array) -> Array:
        whole = np.full((*values.shape[:-2], len(t), values.shape[-1]), np.nan)
        whole[..., places, :] = values
        return whole[..., rows, :]

    used = _used(result)
    fitted = (result.t < result.t[np.argmax(used)] + TARE, result.t < begin)
    constant = np.stack([errors_of_constant_bias(result, seen) for seen in fitted])
    ahead, inside = _errors(result)
    share = (t[rows] - begin) / max(float(t[-1] - begin), 1e-9)
    stretch = np.minimum((SEGMENTS * share).astype(int), SEGMENTS - 1)
    unsettled = t[rows] < settled_at(log.t + log.start, result.params)
    took = np.where(unsettled, np.nan, at_stamps(used[:, None])[:, 0])
    of_tool = np.array([result.noise.tool_error])
    return Judged(at_stamps(ahead), at_stamps(inside), took, stretch, at_stamps(constant), of_tool)


def _used(result: FilterResult) -> Array:
    return np.ones(len(result.t), bool) if result.used is None else np.asarray(result.used)


def _joined(parts: Sequence[Judged]) -> Judged:
    parts = [part._replace(stretch=part.stretch + SEGMENTS * i) for i, part in enumerate(parts)]
    return Judged(*(np.concatenate(arrays, axis=arrays[0].ndim // 2) for arrays in zip(*parts, strict=True)))


def _rms(errors: Array) -> Array:
    """(..., T, 6) -> (..., 6) root mean square without NaN; NaN where nothing is known."""
    return np.sqrt(_mean(errors**2))


def _mean(x: Array) -> Array:
    """(..., T, 6) -> (..., 6) mean without NaN; NaN where nothing is known."""
    known = np.isfinite(x)
    count = known.sum(-2)
    mean: Array = np.where(known, x, 0.0).sum(-2) / np.maximum(count, 1)
    return np.where(count > 0, mean, np.nan)
