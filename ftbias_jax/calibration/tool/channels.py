"""Gains of a sensor's channels and crosstalk between them, from a log that turns a known tool.

reading = M W - bias, with M = 1 + E. Each row of E is a ridge regression of what the tool does not explain on the loads
of all six channels. A few poses constrain E little, and errors that vary slowly mimic crosstalk: so the errors are a
first-order Gauss-Markov process plus white noise, the bias may drift, and the prior size of the entries of E is one
number for the sensor, the likeliest. Held-out blocks of the log decide whether M is accepted. A setup states M by its
effects ``gain`` and ``crosstalk``.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ftbias_jax.calibration.tool.shown import FEWEST_BLOCKS, block_of
from ftbias_jax.filtering.method.ready import filtered_with
from ftbias_jax.filtering.noise import block_filter
from ftbias_jax.filtering.noise.block_filter import Filtered, Grid, filter_blocks
from ftbias_jax.filtering.samples import room_for
from ftbias_jax.io.log import Log
from ftbias_jax.model.effects.catalogue import values_from_setup
from ftbias_jax.model.own_effects import catalogue_of_setup
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import AXES, Array

LEVER = np.where(np.arange(6) < 3, 1.0, 0.1)
"""1, and m: forces and torques of a tool are related by a lever arm of about 0.1 m."""
UNITS = LEVER[:, None] / LEVER[None]
"""(6, 6) 1, N/Nm, Nm/N: scale of the entries of E, relative to those of forces on forces."""
SHARES = np.array([0.0, 0.003, 0.01, 0.02, 0.03, 0.05, 0.1, 0.2])
"""Prior standard deviations of the entries of E to try, in UNITS. Data sheets promise 0.01 to 0.05."""
MEAN_SECONDS, MOST_MEANS = 0.25, 300
"""Length in s, and largest number, of the means that a log is reduced to."""
LEAST_GAIN = 6.0
"""nats that E must gain over E = 0, besides the gain on held-out blocks."""
STANDARD_ERRORS = 3.0
"""Standard errors by which held-out blocks must be likelier."""
WHITE, SLOW, TIMES = 6, 10, 10
"""Numbers of standard deviations of white noise and of slow errors, and of correlation times, to try. Times are up to a
third of the log: what lasts longer is bias and drift."""
WIDE = 30.0
"""Prior standard deviation of the bias, in units of the range of the readings."""


class Channels(NamedTuple):
    """Gains and crosstalk of a sensor's channels."""

    matrix: Array
    """(6, 6) M, reading per load that the setup predicts; 1 on the diagonal where nothing is wrong."""
    stderr: Array
    """(6, 6) standard errors of M."""
    gain: float
    """nats of the likelihood over M = 1."""
    held_out: tuple[float, float]
    """nats that M gains on held-out blocks, and its standard error."""

    @property
    def shown(self) -> bool:
        """Whether the log supports M: held-out blocks are predicted better than with M = 1."""
        gain, error = self.held_out
        return self.gain > LEAST_GAIN and gain > STANDARD_ERRORS * error


class Means(NamedTuple):
    """Means of a log over N intervals of time, in each piece between two tares."""

    t: Array
    """(N,) s."""
    piece: Array
    """(N,) number of tares before."""
    load: Array
    """(N, 6) N, Nm, without their mean."""
    y: Array
    """(N, 6) N, Nm, the measured bias, tool wrench minus reading, without its mean."""
    prior_std: Array
    """(2, 6) prior standard deviations of bias and drift."""


class Posterior(NamedTuple):
    """Posterior of E for S of SHARES and G sets of noise, with bias and drift integrated out."""

    nats: Array
    """(S, G, 6) log evidence of each channel, with E integrated out."""
    mean: Array
    """(S, G, 6, 6) coefficients of the loads, for each channel."""
    variance: Array
    """(S, G, 6, 6) of these coefficients."""


@in_float64
def fit_channels(t: Array, load: Array, measured: Array, drift_std: Array, zeroed_at: tuple[float, ...]) -> Channels:
    """Fit M to a log: t (T,) s, load (T, 6) that the setup predicts, measured (T, 6) load - reading, N, Nm.

    NaN = not measured. ``drift_std`` (6,) N/s, Nm/s is the prior of the bias's drift; ``zeroed_at`` are the times, s,
    at which the sensor was set to zero.
    """
    means = _means(t, load, measured, drift_std, zeroed_at)
    if means is None:
        return Channels(np.eye(6), np.full((6, 6), np.nan), 0.0, (0.0, 0.0))
    grid = _noises(means)
    found = _posterior(means, grid, SHARES)
    of_noise = _log_mean(found.nats, 1)  # (S, 6)
    of_share = of_noise.sum(1)
    best = int(of_share.argmax())
    weight = np.exp(of_share - np.logaddexp.reduce(of_share))[:, None, None] * np.exp(found.nats - of_noise[:, None])
    weight = (weight / len(grid.std))[..., None]
    mean = (weight * found.mean).sum((0, 1))
    variance = (weight * (found.variance + (found.mean - mean) ** 2)).sum((0, 1))
    likeliest = found.nats[best].argmax(0)
    gains = _gains_of_blocks(means, Grid(*(x[None, likeliest, np.arange(6)] for x in grid)), SHARES[best])
    return Channels(
        matrix=np.eye(6) - mean,  # load - reading = bias - E load
        stderr=np.sqrt(variance),
        gain=float(_log_mean(of_share[1:], 0) - of_share[0]),
        held_out=(float(gains.sum()), float(gains.std() * np.sqrt(len(gains)))),
    )


def _log_mean(x: Array, axis: int) -> Array:
    """Logarithm of the mean of exp(x)."""
    most = x.max(axis=axis, keepdims=True)
    return np.squeeze(most, axis) + np.log(np.exp(x - most).mean(axis=axis))


def _means(t: Array, load: Array, measured: Array, drift_std: Array, zeroed_at: tuple[float, ...]) -> Means | None:
    """The log reduced to means; None if it is too short or a channel was not measured."""
    span = t[-1] - t[0]
    number = int(min(span / MEAN_SECONDS, MOST_MEANS))
    seen = np.isfinite(measured).all(1) & np.isfinite(load).all(1)
    if number < 4 * FEWEST_BLOCKS or not seen.any():
        return None
    piece: Array = np.searchsorted(np.array(sorted(zeroed_at)), t)
    stretch = np.minimum((t - t[0]) / span * number, number - 1).astype(int)
    joined = (stretch + number * piece)[seen]  # an interval with a tare in it counts as two
    _, index, count = np.unique(joined, return_inverse=True, return_counts=True)
    # Where the filter rejected samples, their neighbours are no better.
    full = np.flatnonzero(4 * count >= 3 * count.max())
    columns = np.concatenate([t[:, None], piece[:, None], load, measured], 1)[seen].T
    means = np.stack([np.bincount(index, column) / count for column in columns], 1)[full]
    w, y = (x - x.mean(0) for x in (means[:, 2:8], means[:, 8:]))
    prior_std = np.stack([WIDE * np.maximum(np.ptp(y, axis=0), 1e-9), drift_std])
    return Means(means[:, 0], means[:, 1].astype(int), w, y, prior_std)


def _noises(means: Means) -> Grid:
    """Standard deviations of white noise and of slow errors, and correlation times, to try; (G, 6)."""
    t, y = means.t, means.y
    pieces: Array = means.piece[:, None] == np.unique(means.piece)
    columns = np.column_stack([pieces, t - t[0], means.load])
    left = (y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]).std(0)
    most, least = np.maximum(y.std(0), 1e-9), np.maximum(left, 1e-9) / 10
    white, slow = np.geomspace(least, most, WHITE), np.geomspace(least, 2 * most, SLOW)
    times: Array = np.geomspace(float(np.median(np.diff(t))), (t[-1] - t[0]) / 3, TIMES)
    i, j, k = (x.ravel() for x in np.indices((WHITE, SLOW, TIMES)))
    return Grid(white[i] ** 2, slow[j], np.broadcast_to(times[k, None], (len(k), 6)))


def _posterior(means: Means, grid: Grid, shares: Array, seen: Array | None = None) -> Posterior:
    """Posterior of E given the means that are ``seen`` (N,), None = all, for prior standard deviations ``shares`` (S,).

    The filter of bias and slow errors is linear, so it whitens readings and loads alike, and E is a ridge regression of
    the whitened readings on the whitened loads.
    """
    count = len(grid.std)
    constant, pull, information = np.zeros((count, 6)), np.zeros((count, 6, 6)), np.zeros((count, 6, 6, 6))
    for piece in np.unique(means.piece):  # the bias begins anew where the sensor is tared
        rows = means.piece == piece
        out = np.zeros(len(means.t), bool) if seen is None else ~seen
        t, out = means.t[rows], out[rows]
        white = []
        for series in (means.y, *means.load.T[:, :, None]):
            values = np.where(out[:, None], np.nan, np.broadcast_to(series[rows], (len(t), 6)))
            found = _filtered(t, values, grid, means.prior_std)
            white.append(np.nan_to_num(found.innovation) / np.sqrt(found.variance))
        y, loads = white[0], np.stack(white[1:], -1)
        constant += (y**2 + np.log(np.where(out[:, None, None], 1, found.variance))).sum(0)
        pull += np.einsum("nga,ngap->gap", y, loads)
        information += np.einsum("ngap,ngaq->gapq", loads, loads)
    prior = shares[:, None, None, None] * UNITS
    scaled = prior[..., :, None] * information * prior[..., None, :] + np.eye(6)
    inverse, push = np.linalg.inv(scaled), prior * pull
    solved = (inverse @ push[..., None])[..., 0]
    nats = -(constant - (push * solved).sum(-1) + np.linalg.slogdet(scaled)[1]) / 2
    return Posterior(nats, prior * solved, prior**2 * np.diagonal(inverse, axis1=-2, axis2=-1))


def _filtered(t: Array, y: Array, grid: Grid, prior_std: Array) -> Filtered:
    """Filter means (N, 6) as values in the middle of their intervals; padding lets lengths share a few programs."""
    more = room_for(len(t), 64) - len(t)
    y = np.pad(y, [(0, more), (0, 0)], constant_values=np.nan)
    moments = block_filter.Means(np.zeros(()), np.pad(t, (0, more), mode="edge"), y, np.ones_like(y))
    found = _program(moments, grid, prior_std, np.zeros(6))
    return Filtered(*(np.asarray(x)[: len(t)] for x in found))


_program = keep_program()(filter_blocks)


def _gains_of_blocks(means: Means, noise: Grid, share: float) -> Array:
    """(B,) nats by which a block, given all others, is likelier than with E = 0."""
    block = block_of(means.t - means.t[0])

    def gain(seen: Array) -> float:
        with_gains, without = _posterior(means, noise, np.array([share, 0.0]), seen).nats.sum((1, 2))
        return float(with_gains - without)

    return gain(block >= 0) - np.array([gain(block != k) for k in range(block[-1] + 1)])


def find_channels(setup: Setup, log: Log) -> Channels:
    """Gains and crosstalk of a sensor's channels, from a log that turns the tool.

    Args:
        setup: setup with the tool of the log.
        log: log of free motion.
    """
    result, _ = filtered_with(replace(setup, bias=replace(setup.bias, adapt=True)), log)
    measured = result.wrench_tool - (result.wrench_unbiased - result.bias)
    if result.used is not None:
        measured = np.where(result.used[:, None], measured, np.nan)
    drift_std = np.asarray(setup.bias.initial_drift_std, float)
    return fit_channels(result.t - log.start, result.wrench_tool, measured, drift_std, tuple(log.rezeroed_at))


def with_channels(setup: Setup, found: Channels) -> Setup:
    """The setup with these gains and crosstalk applied to those it states; unchanged if the log shows none."""
    if not found.shown:
        return setup
    matrix = found.matrix @ _stated(setup)
    gain = np.diag(matrix)
    effects = {**setup.effects, "gain": {"gain": gain}, "crosstalk": {"matrix": matrix / gain}}
    comments = {
        "effects.gain.gain": f"identified ± {_words(np.diag(found.stderr))}",
        "effects.crosstalk.matrix": f"identified; leaks between forces ± {found.stderr[:3, :3].max():.2g} or less",
    }
    return replace(setup, effects=effects, comments={**setup.comments, **comments})


def channels_in_words(found: Channels) -> list[str]:
    """Lines that describe the gains and crosstalk."""
    nats = f"{found.held_out[0]:.0f} ± {found.held_out[1]:.0f} nats on blocks left out"
    if not found.shown:
        return [f"gains and crosstalk: not shown by this log ({nats}), not written"]
    lines = [f"gains and crosstalk ({nats}): what each channel reads of loads by 1 N and 0.1 Nm"]
    lines.append(" " * 8 + "".join(f"{name:>8s}" for name in AXES))
    scaled = found.matrix * LEVER
    lines += [f"{name:8s}" + "".join(f"{x:8.3f}" for x in row) for name, row in zip(AXES, scaled, strict=True)]
    return lines


def _stated(setup: Setup) -> Array:
    """(6, 6) product that the setup already states: crosstalk after gain."""
    values = values_from_setup(setup.effects, setup.path, catalogue_of_setup(setup))
    gain, leak = np.eye(6), np.eye(6)
    if "gain" in values:
        gain = np.diag(np.asarray(values["gain"]["gain"], float))
    if "crosstalk" in values:
        matrix = np.asarray(values["crosstalk"]["matrix"], float)
        leak = np.where(np.eye(6) > 0, 1.0, matrix)
    return leak @ gain


def _words(values: Array) -> str:
    return " ".join(f"{x:.2g}" for x in values)
