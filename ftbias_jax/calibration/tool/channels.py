"""Gains of a sensor's channels and leaks between them, from a log that turns a known tool.

reading = M W - bias, with M = 1 + E. Each row of E is a ridge regression of what the tool does not explain on the loads
of all six channels. A few poses say little, and errors that vary slowly look like leaks: so the errors are a
first-order Gauss-Markov process beside white noise, the bias may drift, and how large the entries of E may be is one
number for the sensor, the likeliest. Blocks of the log that are left out have the last word.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from ftbias_jax.calibration.tool.shown import FEWEST_BLOCKS, block_of
from ftbias_jax.types import Array

LEVER = np.where(np.arange(6) < 3, 1.0, 0.1)
"""m: forces and torques of a tool are related by a lever of about this length."""
UNITS = LEVER[:, None] / LEVER[None]
"""(6, 6) 1, N/Nm, Nm/N: entries of E are so much larger or smaller than those of forces on forces."""
SHARES = np.array([0.0, 0.003, 0.01, 0.02, 0.03, 0.05, 0.1, 0.2])
"""Standard deviations of the entries of E that are tried, in UNITS. Data sheets promise 0.01 to 0.05."""
MEAN_SECONDS, MOST_MEANS = 0.25, 300
"""s and number of the means that a log is reduced to."""
LEAST_GAIN = 6.0
"""nats over E = 0, below which there is nothing to hold out blocks for."""
STANDARD_ERRORS = 3.0
"""By which blocks that were left out must be likelier."""
WHITE, SLOW, TIMES = 6, 10, 10
"""How many standard deviations of white noise and of slow errors, and correlation times, are tried. Times are up to a
third of the log: what lasts longer is bias and drift."""
WIDE = 1e3
"""Prior of the bias, in the scatter of the readings."""


class Channels(NamedTuple):
    """How the channels of a sensor read loads."""

    matrix: Array
    """(6, 6) M, what is read for each load that the setup predicts; 1 on the diagonal where nothing is wrong."""
    stderr: Array
    """(6, 6)."""
    gain: float
    """nats of the likelihood over M = 1."""
    held_out: tuple[float, float]
    """nats that M gains on blocks left out, and its standard error."""

    @property
    def shown(self) -> bool:
        """Whether the log shows M: predicts blocks that were left out better than with M = 1."""
        gain, error = self.held_out
        return self.gain > LEAST_GAIN and gain > STANDARD_ERRORS * error


class Row(NamedTuple):
    """Means of one channel over N stretches of time, and what they are regressed on."""

    t: Array
    """(N,) s."""
    y: Array
    """(N,) N or Nm, the measured bias, tool - reading."""
    columns: Array
    """(N, P) the bias of every piece between two zeroings, its drift, then the loads of the six channels."""
    nuisance: Array
    """(P - 6,) prior standard deviations of bias and drift."""
    units: Array
    """(6,) of UNITS."""

    def prior(self, share: float) -> Array:
        """(P,) standard deviations."""
        return np.concatenate([self.nuisance, share * self.units])


class Noise(NamedTuple):
    """Of the means of one channel, N or Nm and s."""

    white: float
    slow: float
    time: float


class Posterior(NamedTuple):
    """What a channel shows, for S of SHARES, K correlation times and G pairs of standard deviations."""

    times: Array
    """(K,) s."""
    spreads: Array
    """(G, 2) N or Nm, of white noise and slow errors."""
    nats: Array
    """(S, K, G) likelihood with all coefficients integrated out."""
    mean: Array
    """(S, K, G, 6) of the coefficients of the loads."""
    variance: Array
    """(S, K, G, 6)."""

    def likeliest(self, share: int) -> Noise:
        """The likeliest noise for one of SHARES."""
        k, g = np.unravel_index(self.nats[share].argmax(), self.nats[share].shape)
        white, slow = self.spreads[g]
        return Noise(white, slow, self.times[k])


def fit_channels(t: Array, load: Array, measured: Array, drift_std: Array, zeroed_at: tuple[float, ...]) -> Channels:
    """Fit M to a log.

    Args:
        t: (T,) s.
        load: (T, 6) N, Nm, what the setup expects the sensor to read without bias.
        measured: (T, 6) N, Nm, load - reading; NaN = not measured.
        drift_std: (6,) N/s, Nm/s, prior of the bias's drift.
        zeroed_at: s, times at which the sensor was set to zero.
    """
    rows = _rows(t, load, measured, drift_std, zeroed_at)
    if not rows:
        return Channels(np.eye(6), np.full((6, 6), np.nan), 0.0, (0.0, 0.0))
    posteriors = [_posterior(row, *_noises(row)) for row in rows]
    of_share = sum(_log_mean(each.nats, axis=(1, 2)) for each in posteriors)
    weight = np.exp(of_share - np.logaddexp.reduce(of_share))
    best = int(of_share.argmax())
    found = [_averaged(each, weight) for each in posteriors]
    gains = [
        _gains_of_blocks(row, each.likeliest(best), SHARES[best]) for row, each in zip(rows, posteriors, strict=True)
    ]
    blocks = np.sum(gains, axis=0)
    return Channels(
        matrix=np.eye(6) - np.stack([mean for mean, _ in found]),  # load - reading = bias - E load
        stderr=np.stack([std for _, std in found]),
        gain=float(_log_mean(of_share[1:], axis=0) - of_share[0]),
        held_out=(float(blocks.sum()), float(blocks.std() * np.sqrt(len(blocks)))),
    )


def _log_mean(x: Array, axis: int | tuple[int, ...]) -> Array:
    """Logarithm of the mean of exp(x)."""
    most = x.max(axis=axis, keepdims=True)
    return np.squeeze(most, axis) + np.log(np.exp(x - most).mean(axis=axis))


def _averaged(posterior: Posterior, weight: Array) -> tuple[Array, Array]:
    """Mean (6,) and standard deviation (6,) of a row of -E over all noises, and shares of these weights (S,)."""
    nats = posterior.nats - _log_mean(posterior.nats, axis=(1, 2))[:, None, None]
    of_each = (weight[:, None, None] * np.exp(nats) / nats[0].size)[..., None]
    mean = (of_each * posterior.mean).sum((0, 1, 2))
    variance = (of_each * (posterior.variance + (posterior.mean - mean) ** 2)).sum((0, 1, 2))
    return mean, np.sqrt(variance)


def _rows(t: Array, load: Array, measured: Array, drift_std: Array, zeroed_at: tuple[float, ...]) -> list[Row]:
    """The six channels, reduced to means; none if the log is too short or a channel was not measured."""
    span = t[-1] - t[0]
    number = int(min(span / MEAN_SECONDS, MOST_MEANS))
    seen = np.isfinite(measured).all(1) & np.isfinite(load).all(1)
    if number < 4 * FEWEST_BLOCKS or not seen.any():
        return []
    piece = np.searchsorted(sorted(zeroed_at), t)
    stretch = np.minimum((t - t[0]) / span * number, number - 1).astype(int)
    joined = (stretch + number * piece)[seen]  # a stretch with a zeroing in it counts as two
    _, index, count = np.unique(joined, return_inverse=True, return_counts=True)

    def means(x: Array) -> Array:
        return np.stack([np.bincount(index, column) / count for column in x[seen].T], 1)

    middle, w, y = means(t[:, None])[:, 0], means(load), means(measured)
    of_piece = means(np.eye(len(zeroed_at) + 1)[piece])
    full = 4 * count >= 3 * count.max()  # what the filter rejects tells that its neighbours are no better
    middle, w, y, of_piece = middle[full], w[full], y[full], of_piece[full]
    columns = np.concatenate([of_piece, (middle - middle[0])[:, None], w - w.mean(0)], 1)
    wide = np.ones(of_piece.shape[1]) * WIDE
    off = y - y.mean(0)
    return [
        Row(middle, off[:, i], columns, np.append(wide * max(np.ptp(off[:, i]), 1e-9), drift_std[i]), UNITS[i])
        for i in range(6)
    ]


def _noises(row: Row) -> tuple[Array, Array]:
    """Correlation times (K,) s, and standard deviations (G, 2) of white noise and slow errors, to be tried."""
    left = row.y - row.columns @ np.linalg.lstsq(row.columns, row.y, rcond=None)[0]
    most, least = max(row.y.std(), 1e-9), max(left.std(), 1e-9) / 10
    white, slow = np.geomspace(least, most, WHITE), np.geomspace(least, 2 * most, SLOW)
    step, span = float(np.median(np.diff(row.t))), row.t[-1] - row.t[0]
    return np.geomspace(step, span / 3, TIMES), np.array(list(itertools.product(white, slow)))


def _posterior(row: Row, times: Array, spreads: Array) -> Posterior:
    """What a channel shows for each of SHARES and the noises tried, with bias and drift integrated out.

    Args:
        row: the channel.
        times: (K,) s, correlation times.
        spreads: (G, 2) of ``_noises``.
    """
    priors = np.stack([row.prior(share) for share in SHARES])[:, None]  # (S, 1, P)
    apart = np.abs(row.t[:, None] - row.t)
    nats, means, variances = [], [], []
    for time in times:
        strength, directions = np.linalg.eigh(np.exp(-apart / time))
        variance = spreads[:, :1] ** 2 + spreads[:, 1:] ** 2 * np.maximum(strength, 0)  # (G, N)
        y, columns = directions.T @ row.y, directions.T @ row.columns
        squares, pull = (y**2 / variance).sum(1), (y / variance) @ columns
        information = np.einsum("gn,np,nq->gpq", 1 / variance, columns, columns, optimize=True)
        scaled = priors[..., :, None] * information * priors[..., None, :] + np.eye(priors.shape[-1])
        inverse, push = np.linalg.inv(scaled), priors * pull  # (S, G, P, P), (S, G, P)
        solved = (inverse @ push[..., None])[..., 0]
        cost = squares - (push * solved).sum(2) + np.linalg.slogdet(scaled)[1] + np.log(variance).sum(1)
        nats.append(-cost / 2)
        means.append((priors * solved)[..., -6:])
        variances.append((priors**2 * np.diagonal(inverse, axis1=2, axis2=3))[..., -6:])
    return Posterior(times, spreads, *(np.stack(x, 1) for x in (nats, means, variances)))


def _nats(row: Row, noise: Noise, share: float) -> float:
    """Log-likelihood with bias, drift and E integrated out.

    Args:
        row: the channel.
        noise: of its means.
        share: of SHARES; 0 keeps E at 0.
    """
    apart, prior = np.abs(row.t[:, None] - row.t), row.prior(share)
    covariance = noise.slow**2 * np.exp(-apart / noise.time) + noise.white**2 * np.eye(len(row.t))
    root = np.linalg.cholesky(covariance)
    white = np.linalg.solve(root, np.column_stack([row.y, row.columns * prior]))
    y, scaled = white[:, 0], white[:, 1:]
    information = scaled.T @ scaled + np.eye(len(prior))
    push = scaled.T @ y
    squares = y @ y - push @ np.linalg.solve(information, push)
    return float(-np.log(np.diag(root)).sum() - np.linalg.slogdet(information)[1] / 2 - squares / 2)


def _gains_of_blocks(row: Row, noise: Noise, share: float) -> Array:
    """(B,) nats by which a block is likelier, given all others, than with E = 0."""
    block = block_of(row.t - row.t[0])

    def gain(seen: Array) -> float:
        left = row._replace(t=row.t[seen], y=row.y[seen], columns=row.columns[seen])
        return _nats(left, noise, share) - _nats(left, noise, 0.0)

    return gain(block >= 0) - np.array([gain(block != k) for k in range(block[-1] + 1)])
