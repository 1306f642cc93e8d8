"""Errors of a filtered log's predictions of its reading some seconds ahead, and coverage of their intervals."""

import numpy as np

AHEAD = (1.0, 10.0)
"""s: prediction horizons."""
WITHIN = 1.96
"""Half width of a 95 % interval in standard deviations."""


def reading_of(result):
    """Measured wrench (T, 6) N, Nm."""
    return result.wrench_unbiased - result.bias


def measured_bias(result):
    """Bias (T, 6) N, Nm implied by each reading, if it had no noise and there were no contact."""
    return result.wrench_tool - reading_of(result)


def past_of(t, ahead):
    """Index (T,) of the newest sample that is at least ``ahead`` s old; -1 = none."""
    return np.searchsorted(t, t - ahead, side="right") - 1


def prediction(result, ahead):
    """Measured bias (T, 6) N, Nm that the state ``ahead`` s earlier predicts for now; NaN = no state is that old."""
    past = past_of(result.t, ahead)
    return np.where((past >= 0)[:, None], result.forecast(ahead).mean[past], np.nan)


def rms(errors):
    """Root mean square (6,) over the samples that are not NaN."""
    return np.sqrt(np.nanmean(np.square(errors), axis=0))


def errors(result, ahead):
    """Error (T, 6) N, Nm: measured minus predicted bias, which is minus the error of the predicted reading."""
    return measured_bias(result) - prediction(result, ahead)


def inside(result, ahead):
    """Return (T, 6): 1 = the reading is in its predicted 95 % interval, 0 = it is not; NaN = not predicted or used."""
    then, std = past_of(result.t, ahead), result.forecast(ahead).std
    # The noise due to motion is taken at the predicted sample, because the future motion of the arm counts as known.
    variance = std[then] ** 2 - result.reading_std[then] ** 2 + result.reading_std**2
    error = np.where(result.used[:, None], errors(result, ahead), np.nan)
    return np.where(np.isfinite(error), np.abs(error) < WITHIN * np.sqrt(variance), np.nan)


def slow_and_fast(result):
    """Masks (T,) of the slowest and of the fastest tenth of the samples, by the norm of the joint velocities."""
    speed = np.linalg.norm(result.dq, axis=1)
    return speed <= np.quantile(speed, 0.1), speed >= np.quantile(speed, 0.9)


def nis(result, rows):
    """Mean normalised innovation squared (6,) of each axis; 1 for a right model."""
    return np.nanmean((result.innovation[rows] / result.innovation_std[rows]) ** 2, axis=0)
