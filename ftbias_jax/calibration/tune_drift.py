"""Choice of the drift that forecasts best on blocks: the stated one, a stronger or weaker one, or one that reverts.

The likelihood of the next block depends on what happens within seconds. A drift that follows slow model errors is
likely, but carries the bias away from its later value: so it must also predict the reading 1 s and 10 s ahead, by bias,
drift and slow error, as filter results do (``quality.ahead``).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.filtering.noise.block_filter import Grid, filter_series
from ftbias_jax.filtering.noise.slow_noise import nats_of
from ftbias_jax.filtering.quality.ahead import expected_ahead
from ftbias_jax.model.params import BiasNoise
from ftbias_jax.types import Array

TIMES = (np.inf, 300.0, 100.0, 30.0, 10.0)
"""s, time constants of a drift that reverts to zero, at most half a log. A shorter one makes the bias a random walk."""
FACTORS = 10.0 ** np.arange(-2, 3.6, 0.5)
"""Factors of the stated sigma_Q to try."""
HALF_A_STEP = 10**0.25 - 1
"""Relative uncertainty of sigma_Q where it is one of them."""
HORIZONS = (1.0, 10.0)
"""s ahead at which forecasts are scored."""
LEAST_GAIN = 6.0
"""nats that another drift must gain over the stated one to be chosen."""


class Series(NamedTuple):
    """Block means of a log."""

    t: Array
    """(N,) s."""
    y: Array
    """(N, 6) N, Nm, means of the measured bias; NaN = not measured, or in contact."""
    variance: Array
    """(N, 6) N^2, Nm^2 of those means if the noise is white."""
    prior_std: Array
    """(12,) square root of P_0."""


class Drift(NamedTuple):
    """Process noise and time constant of the drift; (6,)."""

    density: Array
    """sigma_Q, N/s^1.5, Nm/s^1.5."""
    time: Array
    """s, time constant with which the drift reverts to zero; inf = never."""


def stated_drift(bias: BiasNoise) -> Drift:
    """Process noise and time constant of the drift that the parameters state."""
    never = np.full(6, np.inf)
    return Drift(np.asarray(bias.density, float), never if bias.drift_time is None else np.asarray(bias.drift_time))


class Scores(NamedTuple):
    """Scores of G drifts on all logs; (G, 6)."""

    nats: Array
    squares: Array
    """(H, G, 6) N^2, Nm^2: mean squared error of the reading predicted HORIZONS ahead; NaN = no log is long enough."""


def choose_drift(
    logs: Sequence[Series], slow: tuple[Array, Array], stated: Drift, fitted: Array, group: Array
) -> Drift:
    """The likeliest drift of those that forecast no worse than the stated one at any horizon, else the stated one.

    ``slow`` is standard deviation and correlation time, (6,) each, of the correlated noise; ``fitted`` (6,) is the
    fitted sigma_Q of a drift that does not revert; axes with the same number in ``group`` (6,) are decided together.
    """
    longest = max(log.t[-1] - log.t[0] for log in logs)
    times = [time for time in TIMES if np.isinf(time) or time <= longest / 2]
    drifts = [stated, Drift(fitted, np.full(6, np.inf))]
    drifts += [Drift(factor * stated.density, np.full(6, time)) for time in times for factor in FACTORS]
    candidates = Drift(*(np.stack(x) for x in zip(*drifts, strict=True)))
    scores = score(logs, slow, candidates)
    chosen = np.zeros(6, int)
    for g in np.unique(group):
        axes = group == g
        gain = (scores.nats - scores.nats[0])[:, axes].sum(1)
        errors = scores.squares[:, :, axes] / scores.squares[:, :1, axes]
        worse = (np.nan_to_num(errors, nan=1.0) > 1).any(axis=(0, 2))
        gain = np.where(worse, -np.inf, gain)
        chosen[axes] = gain.argmax() if gain.max() > LEAST_GAIN else 0
    return Drift(*(x[chosen, np.arange(6)] for x in candidates))


def score(logs: Sequence[Series], slow: tuple[Array, Array], drifts: Drift) -> Scores:
    """Log-likelihood and forecast errors of G drifts, arrays (G, 6), with the correlated noise of ``choose_drift``."""
    shape = drifts.density.shape
    grid = Grid(np.ones(shape), *(np.broadcast_to(x, shape) for x in slow))
    nats, squares, counts = np.zeros(shape), np.zeros((len(HORIZONS), *shape)), np.zeros((len(HORIZONS), 1, 6))
    for t, y, variance, prior_std in logs:
        found = filter_series(t, y, variance, grid, prior_std.reshape(2, 6), drifts.density, 1 / drifts.time)
        half = float(np.median(np.diff(t))) / 2 if len(t) > 1 else 0.0
        # Scaled from the end of its block to the middle, from where bias and drift are predicted.
        slow_error = np.exp(half / grid.time) * found.slow
        nats += np.asarray(nats_of(found.innovation, found.variance))
        for i, ahead in enumerate(HORIZONS):
            past = np.searchsorted(t, t - ahead, side="right") - 1
            rows = past >= 0
            then = past[rows]
            states = found.bias[then], found.drift[then], slow_error[then]
            expected = expected_ahead(*states, (drifts.time, grid.time), ahead)
            errors = y[rows, None] - expected
            squares[i] += np.nansum(errors**2, axis=0)
            counts[i, 0] += np.isfinite(y[rows]).sum(0)
    return Scores(nats, squares / np.where(counts > 0, counts, np.nan))
