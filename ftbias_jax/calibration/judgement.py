"""Compare a tuned setup with the previous one by its predictions on held-out data.

A likelihood that models only white noise mistakes correlated noise for a rapidly wandering bias: the one-step score
rises while the reading one second ahead is mispredicted by newtons. So a tuned setup must also predict the reading 1 s
and 10 s ahead no worse than the previous one, on the part of each log that was not fitted. A score falls only if it
falls by more than it varies along the logs.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import numpy as np

from ftbias_jax.calibration.newton import Total, alone
from ftbias_jax.filtering import params_for_log
from ftbias_jax.filtering.likelihood import joint_log_likelihood, wrench_given_joints
from ftbias_jax.filtering.method.ready import filtered_with
from ftbias_jax.filtering.noise.log_noise import LogNoise
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.filtering.quality.ahead import expected_ahead
from ftbias_jax.filtering.result import Filtered
from ftbias_jax.filtering.samples import pad
from ftbias_jax.filtering.verbs.results import FilterResult
from ftbias_jax.io.log import Log
from ftbias_jax.model.params import BiasNoise, Params
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import AXES, Array, Sample

HORIZONS = (1.0, 10.0)
"""s ahead at which predictions are compared."""
WORSE = 1.05
"""Ratio of prediction errors, after to before, above which the tuned setup is worse; less is chance."""
FEWEST = 200
"""Fewest predictions that give an rms error."""
MOST_LOGS = 100
"""Largest number of logs that are compared, evenly spaced among more; both setups are judged on the same ones."""
SHORT = 20.0
"""s; a shorter log hardly constrains how the bias moves."""
STILL = 0.02
"""rad/s: joints that never move faster are at rest."""
LEAST_LOSS = 1.0
"""nats/s on held-out data; a smaller loss is negligible."""
SEGMENTS = 8
"""Number of segments of each log's held-out end; the standard error of a score is from the scatter over them."""
SURE = 2.0
"""Number of standard errors; a smaller loss is chance."""
BURN_IN = 1.0
"""s at the start of held-out data that the score leaves out."""
LIKELIHOODS: dict[str, Callable[..., Array]] = {"joint": joint_log_likelihood, "wrench": wrench_given_joints}


class Predicted(NamedTuple):
    """Root mean square errors of the predicted reading, (6,) N, Nm."""

    seconds: float
    """s, prediction horizon."""
    before: Array
    after: Array
    constant: Array
    """Errors of a constant bias, the mean over the fitted part; NaN on axes that were not measured there."""

    @property
    def worse(self) -> list[str]:
        """Axes on which the tuned setup predicts worse."""
        return _larger(self.after, self.before)

    @property
    def constant_better(self) -> list[str]:
        """Axes on which the constant bias predicts better than the tuned setup."""
        return _larger(self.after, self.constant)


def _larger(errors: Array, others: Array) -> list[str]:
    """Names of axes on which errors (6,) are larger than others (6,) by more than chance."""
    return [name for name, x, other in zip(AXES, errors, others, strict=True) if x > WORSE * other]


class HeldOut(NamedTuple):
    """Log-likelihood of held-out data, nats per second."""

    part: str
    """"joint" or "wrench"."""
    before: float
    """Score with the noise of the setup."""
    after: float
    """Score with the tuned noise."""
    stderr: float
    """Standard error of the difference, from its variation along the logs."""

    @property
    def falls(self) -> bool:
        """Whether the tuned noise explains the data worse, by more than chance."""
        return self.before - self.after > max(LEAST_LOSS, SURE * self.stderr)


def held_out(part: str, nats: Array, seconds: float, total: Total = alone) -> list[HeldOut]:
    """Scores of M tuned setups beside that of the setup before them.

    nats (1 + M, N) are of N segments of held-out data, which last ``seconds`` in total; ``total`` sums over the
    processes that tune together.
    """
    gain = nats[1:] - nats[:1]
    variance = gain.shape[1] * gain.var(1, ddof=1)
    seconds, sums = total(seconds, np.concatenate([nats.sum(1), variance]))
    before, *after = sums[: len(nats)] / seconds
    stderr = np.sqrt(sums[len(nats) :]) / seconds
    return [HeldOut(part, float(before), float(x), float(e)) for x, e in zip(after, stderr, strict=True)]


def held_out_samples(
    before: Sequence[Params],
    tuned: Sequence[Sequence[Params]],
    logs: Sequence[Sequence[Sample]],
    options: Options,
    total: Total,
) -> list[tuple[HeldOut, HeldOut]]:
    """Sample-wise scores of joints and wrench for each of several tuned sets of parameters.

    ``before`` and each tuned set hold the parameters of each tool, ``logs`` the held-out samples of each tool.
    """
    parts = [
        (tool, pad(log, params_for_log.padded_length(len(log.dt))), float(log.dt.sum()))
        for tool, of_tool in enumerate(logs)
        for log in of_tool
    ]

    def of_part(part: str) -> list[HeldOut]:
        def after(params: Params, log: Sample, begin: Array) -> Array:
            return LIKELIHOODS[part](params, log, options, begin)

        rest = jax.jit(jax.vmap(after, (None, None, 0)))

        def in_stretches(params: Params, log: Sample, seconds: float) -> Array:
            begins = np.linspace(min(BURN_IN, seconds), seconds, SEGMENTS, endpoint=False)
            return -np.diff(np.asarray(rest(params, log, begins)), append=0.0)

        nats = [
            np.concatenate([in_stretches(params[tool], log, seconds) for tool, log, seconds in parts])
            for params in (before, *tuned)
        ]
        return held_out(part, np.array(nats), sum(seconds for *_, seconds in parts), total)

    return list(zip(of_part("joint"), of_part("wrench"), strict=True))


def judge_predictions(
    before: Setup, after: Sequence[Setup], logs: Sequence[Log], hold_out: float
) -> list[tuple[Predicted, ...]]:
    """Prediction errors of each tuned setup and of the one before, on the end of every log at horizons that fit in.

    At most MOST_LOGS of the logs are used; the filter processes them whole, as a user's would.
    """
    logs = logs[:: -(-len(logs) // MOST_LOGS)]
    totals = {h: np.zeros((len(after), 3, 6)) for h in HORIZONS}
    counts = {h: np.zeros((len(after), 6)) for h in HORIZONS}
    for log in logs:
        results = [filtered_with(setup, log, len(logs)) for setup in (before, *after)]
        begin = log.t[0] + log.start + (1 - hold_out) * (log.t[-1] - log.t[0])
        unseen = results[0][0].t >= begin
        of_constant = errors_of_constant_bias(results[0][0], ~unseen)
        for h in HORIZONS:
            errors = np.stack([prediction_errors(result, params.bias, h) for result, params in results])
            for i in range(len(after)):
                compared = np.stack([errors[0], errors[i + 1], of_constant])[:, unseen]
                both = np.isfinite(compared[:2]).all(0)
                totals[h][i] += np.where(both[None], compared**2, 0).sum(1)
                counts[h][i] += both.sum(0)

    def of_setup(i: int) -> tuple[Predicted, ...]:
        shown = [h for h in HORIZONS if counts[h][i].max() >= FEWEST]
        return tuple(Predicted(h, *np.sqrt(totals[h][i] / np.maximum(counts[h][i], 1))) for h in shown)

    return [of_setup(i) for i in range(len(after))]


def prediction_errors(result: Filtered | FilterResult, noise: BiasNoise, ahead: float) -> Array:
    """(T, 6) N, Nm: the reading minus what ``FilterResult.forecast`` predicted ``ahead`` s before; NaN = not predicted.

    Contact cannot be predicted, so samples that the filter did not use are left out. Before the first used sample
    nothing is known of the bias of this log, and nothing is predicted.
    """
    first = 0 if result.used is None else np.argmax(result.used)
    past = np.searchsorted(result.t, result.t - ahead, side="right") - 1
    reading = result.wrench_unbiased - result.bias
    times = (noise.drift_time, noise.correlated_time)
    later = expected_ahead(result.bias, result.drift, result.slow_error, times, ahead)
    errors = np.where((past >= first)[:, None], reading - (result.wrench_tool - later[past]), np.nan)
    return _of_used(result, errors)


def _of_used(result: Filtered | FilterResult, errors: Array) -> Array:
    """(T, 6) errors, NaN at the samples that the filter did not use."""
    return errors if result.used is None else np.where(result.used[:, None], errors, np.nan)


def errors_of_constant_bias(result: Filtered | FilterResult, fitted: Array) -> Array:
    """(T, 6) N, Nm: the reading minus the tool's wrench and one bias, the mean over the ``fitted`` samples (T,)."""
    error = _of_used(result, result.wrench_unbiased - result.bias - result.wrench_tool)
    counts = np.isfinite(error) & fitted[:, None]
    mean = np.where(counts, error, 0).sum(0) / np.maximum(counts.sum(0), 1)
    return np.where(counts.any(0), error - mean, np.nan)


def what_the_logs_show(noises: Sequence[LogNoise], logs: Sequence[Log]) -> list[str]:
    """Reasons, in words, why the logs may not determine their noise; none if nothing stands out."""
    words = []
    if any(noise.slow is not None and noise.slow.std.any() for noise in noises):
        words.append("noise that is correlated over time, which white noise and drift cannot describe")
    if any(noise.contacts for noise in noises):
        words.append("contact")
    if max(log.t[-1] - log.t[0] for log in logs) < SHORT:
        words.append(f"less than {SHORT:g} s of data")
    if all(_fastest(log) < STILL for log in logs):
        words.append("a robot at rest")
    return words


def _fastest(log: Log) -> float:
    """rad/s, speed of the fastest joint from positions a tenth of a second or more apart."""
    step = float(np.median(np.diff(log.t))) if len(log.t) > 1 else 1.0
    q = log.q[np.isfinite(log.q).all(1)][:: max(1, round(0.1 / step))]
    return float(np.abs(np.diff(q, axis=0)).max(initial=0.0) / max(0.1, step))
