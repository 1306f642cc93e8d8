"""How well the tool model and the bias explain a filtered log, accumulated over its parts."""

from typing import NamedTuple

import numpy as np

from ftbias_jax.filtering.quality.ahead import expected_ahead
from ftbias_jax.filtering.result import Filtered
from ftbias_jax.model.params import BiasNoise
from ftbias_jax.types import AXES, Array

AHEAD = 1.0
"""s, horizon of the forecast whose error is summarised."""
WORSE = 1.1
"""Factor by which a residual must exceed the variation of the reading to count as worse."""
MODEL_OFF = 0.05
"""Share of the samples, outside of contact, above which rejection by the gate indicates an error of the model."""
FAR = 8.0
"""Standard deviations that noise does not reach."""


class Moments(NamedTuple):
    """Count, mean and sum of squares about the mean of values by axis; each (6,)."""

    count: Array
    mean: Array
    squares: Array


class Tally(NamedTuple):
    """Running sums over the samples so far."""

    moments: tuple[Moments, ...]
    """Moments of the raw wrench, of the corrected wrench minus the tool model, of the error of predicting it AHEAD, and
    of the corrected wrench minus the tool model where the gate rejected it and no contact is known."""
    counts: Array
    """(5,) sum of the NIS, measured axes of all used samples, samples, samples that are not used at all, and used
    samples with an axis FAR off its prediction."""
    first: float
    """s, the first stamp."""
    recent: tuple[Array, ...] | None
    """t (R,), bias, drift and slow error (R, 6) of the last samples, back to one at least AHEAD before the last."""
    last: Filtered | None
    """The last part."""


class Summary(NamedTuple):
    """How well the tool model and the bias explain a log; (6,) N, Nm unless stated. NaN for axes never measured."""

    samples: int
    gated: int
    """Number of them that were not used."""
    off: int
    """Number of them that were measured but not used, outside of the contacts that were found."""
    off_rms: Array
    """Rms of corrected wrench minus tool model at those samples; NaN = there are none."""
    far: int
    """Number of used samples with an axis FAR standard deviations off its prediction or farther."""
    seconds: float
    bias: Array
    """Bias at the end of the log, with drift N/s, Nm/s and standard deviations."""
    bias_std: Array
    drift: Array
    drift_std: Array
    raw_std: Array
    """Standard deviation of the wrench as read."""
    residual_std: Array
    """Standard deviation of corrected wrench minus tool model; a fast bias process alone makes it small."""
    one_second_rms: Array
    """Rms error of the reading that ``FilterResult.forecast`` expected one second earlier; no bias process makes it
    small."""
    mean_nis: float
    """Mean normalised innovation squared per measured axis; 1 for a right model."""


def start() -> Tally:
    """Empty tally before the first part."""
    nothing = Moments(np.zeros(6), np.zeros(6), np.zeros(6))
    return Tally((nothing,) * 4, np.zeros(5), np.nan, None, None)


def add(tally: Tally, part: Filtered, noise: BiasNoise) -> Tally:
    """Add the next part, filtered with this noise; parts without a wrench change nothing."""
    if not len(part.t):
        return tally
    raw = part.wrench_unbiased - part.bias
    # One-second-ahead errors use the newest state at least one second old.
    slow = np.zeros((len(part.t), 6), part.bias.dtype) if part.slow_error is None else part.slow_error
    # Before the first used reading there is only the prior, which predicts nothing.
    before = tally.recent is not None and len(tally.recent[0]) > 0
    measured = np.isfinite(part.innovation)
    used = np.ones(len(measured), bool) if measured.all() else measured.any(1)
    begun = 0 if before else int(used.argmax()) if used.any() else len(used)
    states = tuple(x[begun:] for x in (part.t, part.bias, part.drift, slow))
    recent = states if tally.recent is None else tuple(map(np.concatenate, zip(tally.recent, states, strict=True)))
    t, bias, drift, slow = recent
    past = np.searchsorted(t, part.t - AHEAD, side="right") - 1
    known = slice(int(np.searchsorted(past, 0)), None)  # ``past`` increases
    past = past[known]
    elapsed = (part.t[known] - t[past])[:, None]
    times = (noise.drift_time, noise.correlated_time)
    predicted = part.wrench_tool[known] - expected_ahead(bias[past], drift[past], slow[past], times, elapsed)
    far = np.abs(part.innovation) > FAR * part.innovation_std
    keep = max(np.searchsorted(t, part.t[-1] - AHEAD, side="right") - 1, 0)
    residual = part.wrench_unbiased - part.wrench_tool
    # If contact was not searched for, any sample that the gate rejected may be contact.
    off = ~used & (False if part.in_contact is None else ~part.in_contact)
    values = (raw, residual, raw[known] - predicted, residual[off & np.isfinite(residual).any(1)])
    moments = tuple(map(_merge, tally.moments, values))
    taken, left_out = np.count_nonzero(measured), np.count_nonzero(~used)
    counts = [float(part.nis.sum()), taken, len(part.t), left_out, far.any(1).sum() if far.any() else 0]
    first = float(part.t[0]) if tally.recent is None else tally.first
    return Tally(moments, tally.counts + counts, first, tuple(x[keep:] for x in (t, bias, drift, slow)), part)


def finish(tally: Tally) -> Summary:
    """The summary of the parts that were added; needs at least one sample."""
    last = tally.last
    assert last is not None
    with np.errstate(invalid="ignore"):
        raw_std, residual_std, ahead_std, off_std = (np.sqrt(x.squares / x.count) for x in tally.moments)
        off_rms = np.hypot(off_std, np.where(tally.moments[3].count > 0, tally.moments[3].mean, np.nan))
    one_second_rms = np.hypot(ahead_std, tally.moments[2].mean)
    bias, bias_std, drift, drift_std = (x[-1] for x in (last.bias, last.bias_std, last.drift, last.drift_std))
    nis, used, samples, gated, far = tally.counts.tolist()
    seconds, mean_nis = float(last.t[-1]) - tally.first, nis / used if used else np.nan
    at_end = (bias, bias_std, drift, drift_std, raw_std, residual_std, one_second_rms)
    off = int(tally.moments[3].count.max())
    return Summary(int(samples), int(gated), off, off_rms, int(far), seconds, *at_end, mean_nis)


def worse_than_raw(summary: Summary) -> bool:
    """Whether corrected force or torque deviates more from the tool model than it varies as read."""
    raw, residual = (np.nansum(x.reshape(2, 3) ** 2, axis=1) for x in (summary.raw_std, summary.residual_std))
    return bool((residual > WORSE**2 * raw).any())


def format_summary(summary: Summary) -> str:
    """The summary as a table for engineers, one column per axis."""
    rows = {
        "bias at the end": summary.bias,
        "  ± 1 sigma": summary.bias_std,
        "drift per minute": 60 * summary.drift,
        "  ± 1 sigma ": 60 * summary.drift_std,
        "raw reading, std": summary.raw_std,
        "corrected - tool model, std": summary.residual_std,
        "1 s ahead prediction, rms": summary.one_second_rms,
    }
    head = f"{summary.samples} wrench samples, {summary.seconds:.1f} s\n{'':28s}" + "".join(
        f"{name + (' [N]' if i < 3 else ' [Nm]'):>11s}" for i, name in enumerate(AXES)
    )
    lines = [f"{name:28s}" + "".join(f"{x:11.4f}" for x in values) for name, values in rows.items()]
    nis = f"normalised innovation squared per axis: {summary.mean_nis:.2f} (1 = model, and noise as taken, are right)"
    return "\n".join([head, *lines, nis, *_gate_lines(summary)])


def _gate_lines(summary: Summary) -> list[str]:
    """Lines on rejected samples. If very many are off, the model may be wrong, which no gate corrects."""
    if summary.off > MODEL_OFF * summary.samples:
        force, torque = (np.sqrt(np.nansum(x**2)) for x in (summary.off_rms[:3], summary.off_rms[3:]))
        share = f"{summary.off} samples ({summary.off / summary.samples:.0%}) outside of contact"
        return [
            f"{share} were rejected by the gate: the model is off by {force:.2g} N, {torque:.2g} Nm; ftbias diagnose"
        ]
    if summary.gated:
        return [f"{summary.gated} samples ({summary.gated / summary.samples:.2%}) were rejected by the gate: contact?"]
    if summary.far:
        line = f"{summary.far} samples are far off their prediction: contact? --gate 5 keeps them out of the bias"
        return [line + ("; or a wrong setup? ftbias diagnose" if summary.far > summary.samples / 4 else "")]
    return []


def _merge(sums: Moments, values: Array) -> Moments:
    """Moments after adding values (T, 6), NaN = none (Chan, Golub and LeVeque 1979)."""
    seen = np.isfinite(values)
    is_whole = bool(seen.all())
    more = np.full(values.shape[1], len(values)) if is_whole else seen.sum(0)
    count = sums.count + more
    mean = np.ones(len(values)) @ (values if is_whole else np.where(seen, values, 0)) / np.maximum(more, 1)
    off = values - mean if is_whole else np.where(seen, values - mean, 0)
    squares = np.einsum("ta,ta->a", off, off)
    shift = mean - sums.mean
    share = more / np.maximum(count, 1)
    return Moments(count, sums.mean + shift * share, sums.squares + squares + shift**2 * sums.count * share)
