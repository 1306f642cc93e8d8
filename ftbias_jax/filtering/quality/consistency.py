"""Consistency of the filter's error bars: NIS and NEES against chi-square bounds, and whiteness of innovations."""

from typing import NamedTuple

import numpy as np

from ftbias_jax.types import Array

LAGS = 20
"""Number of lags, in samples, over which the whiteness of the innovations is tested."""


class Average(NamedTuple):
    """An average of chi-square variables and the interval that contains 95 % of such averages if the model is right."""

    value: float
    low: float
    high: float

    @property
    def consistent(self) -> bool:
        """Whether the value is inside its bounds."""
        return self.low <= self.value <= self.high


class Consistency(NamedTuple):
    """Consistency of the wrench innovations of one log; leading axis of 6 axes."""

    nis: Average
    """Mean normalised innovation squared per measured axis; 1 if all is right."""
    axis_nis: np.ndarray
    """(6,) mean NIS of each axis; above 1: noise understated or an effect unmodelled, below 1: noise overstated."""
    lag_one: np.ndarray
    """(6,) correlation of neighbouring innovations; 0 for a right model."""
    lag_one_bound: np.ndarray
    """(6,) 95 % bound on its magnitude for a right model."""
    ljung_box: np.ndarray
    """(6,) Ljung-Box statistic over LAGS lags, divided by LAGS: 1 for a right model."""


def mean_chi_square(squares: Array, dof: int) -> Average:
    """Average of independent normalised squares over samples (NIS) or runs (NEES), and its 95 % bounds.

    Args:
        squares: (N,) chi-square variables.
        dof: degrees of freedom of each.
    """
    squares = np.asarray(squares, float)
    total = len(squares) * dof
    return Average(float(squares.mean()), *(chi_square_quantile(p, total) / len(squares) for p in (0.025, 0.975)))


def chi_square_quantile(probability: float, dof: float) -> float:
    """Chi-square quantile by Wilson and Hilferty (1931); for dof above 30 within 0.1 %."""
    from statistics import NormalDist

    spread = 2 / (9 * dof)
    return float(dof * (1 - spread + NormalDist().inv_cdf(probability) * spread**0.5) ** 3)


def check(innovation: Array, nis_of_axes: Array) -> Consistency:
    """Consistency of a filtered log: innovations (T, 6) N, Nm, NaN = not measured, and their squares over variances."""
    measured = np.isfinite(innovation)
    squares = np.where(measured, nis_of_axes, np.nan)
    white = np.sign(innovation) * np.sqrt(nis_of_axes)
    correlations = np.full((LAGS, 6), np.nan)
    for axis in range(6):
        series = white[measured[:, axis], axis]
        if len(series) > 2 * LAGS:
            power = series @ series
            correlations[:, axis] = [series[lag:] @ series[:-lag] / power for lag in range(1, LAGS + 1)]
    count = measured.sum(0)
    weights = 1 / np.maximum(count - np.arange(1, LAGS + 1)[:, None], 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        box = count * (count + 2) * (correlations**2 * weights).sum(0) / LAGS
        axis_nis = np.nansum(squares, 0) / np.where(count, count, np.nan)
        bound = 1.96 / np.sqrt(count)
    return Consistency(mean_chi_square(squares[measured], 1), axis_nis, correlations[0], bound, box)


def verdict(result: Consistency) -> str:
    """One sentence that summarises a check."""
    nis = result.nis
    inside = f"NIS per axis {nis.value:.3f}, 95 % interval for a correct model: {nis.low:.3f} to {nis.high:.3f}"
    if not np.isfinite(result.lag_one).any():
        return f"not judged, because the log has too few samples: {inside}"
    correlated = np.nanmax(np.abs(result.lag_one) / result.lag_one_bound)
    if nis.value > nis.high:
        return f"overconfident: {inside}; the noise is understated or something is not modelled (ftbias diagnose)"
    if nis.value < nis.low:
        return f"underconfident: {inside}; the noise is overstated (ftbias tune)"
    if correlated > 3:
        return f"NIS consistent, but innovations are not white: {inside}; neighbouring innovations are correlated"
    return f"consistent: {inside}"


def format_check(result: Consistency) -> str:
    """Consistency of the filter as a small table and a sentence."""
    rows = {
        "NIS (1 = right)": result.axis_nis,
        "correlation of neighbours": result.lag_one,
        "  95 % bound": result.lag_one_bound,
        "Ljung-Box / lags (1 = white)": result.ljung_box,
    }
    lines = [f"{name:28s}" + "".join(f"{x:11.3f}" for x in values) for name, values in rows.items()]
    return "\n".join(["consistency of the innovations:", *lines, verdict(result)])
