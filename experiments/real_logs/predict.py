"""How well a filtered log predicts its own reading some seconds ahead, and whether the intervals of that hold."""

import numpy as np

AHEAD = (1.0, 10.0)
"""s."""
WITHIN = 1.96
"""Standard deviations of a 95 % interval."""


def reading_of(result):
    """(T, 6) N, Nm, the wrench as measured."""
    return result.wrench_unbiased - result.bias


def measured_bias(result):
    """(T, 6) N, Nm: what the bias would be if this reading had no noise and nothing touched the tool."""
    return result.wrench_tool - reading_of(result)


def past_of(t, ahead):
    """(T,) index of the newest sample that is at least so old, -1 = none."""
    return np.searchsorted(t, t - ahead, side="right") - 1


def prediction(result, ahead):
    """(T, 6) N, Nm: what the state so many seconds ago expects to be measured now; NaN = there is none so old."""
    past = past_of(result.t, ahead)
    return np.where((past >= 0)[:, None], result.forecast(ahead).mean[past], np.nan)


def rms(errors):
    """(6,) root mean square over what is not NaN."""
    return np.sqrt(np.nanmean(np.square(errors), axis=0))


def errors(result, ahead):
    """(T, 6) N, Nm: bias measured now less bias predicted; this is minus the error of the predicted reading."""
    return measured_bias(result) - prediction(result, ahead)


def inside(result, ahead):
    """(T, 6) 1 where the reading is in the 95 % interval predicted for it, 0 where not; NaN = not predicted or used."""
    then, std = past_of(result.t, ahead), result.forecast(ahead).std
    # The noise that the motion makes is that of now; how the arm will move is known.
    variance = std[then] ** 2 - result.reading_std[then] ** 2 + result.reading_std**2
    error = np.where(result.used[:, None], errors(result, ahead), np.nan)
    return np.where(np.isfinite(error), np.abs(error) < WITHIN * np.sqrt(variance), np.nan)


def slow_and_fast(result):
    """(T,) twice: samples of the slowest and of the fastest tenth, by the root sum square of the joints' speeds."""
    speed = np.linalg.norm(result.dq, axis=1)
    return speed <= np.quantile(speed, 0.1), speed >= np.quantile(speed, 0.9)


def nis(result, rows):
    """(6,) normalised innovation squared of each axis; 1 for a right model."""
    return np.nanmean((result.innovation[rows] / result.innovation_std[rows]) ** 2, axis=0)
