"""Averaging of samples over short bins or a moving window, and padding of bins to a few lengths."""

import numpy as np

SHORTEST_BIN = 0.01
"""s; shortest bin, with which a 25 Hz oscillation of the tool is still resolved."""
BINS = (1024, 2048, 4096, 8192)
"""Lengths that binned logs are padded to, so that they share compiled programs."""
MOST_BINS = 4096
"""Largest number of bins; longer logs get longer bins."""
REACH = 16
"""Samples before and after one, together, over which the moving mean gives the slow part of a signal."""


def bins_of(t: np.ndarray, duration: float) -> tuple[np.ndarray, int, int]:
    """The bin (T,) of every sample measured at t (T,) s, the number of bins, and their number with padding."""
    width = max(SHORTEST_BIN, np.nextafter(duration / MOST_BINS, np.inf))  # so that the last sample is in the last bin
    # Bins without a sample are left out, so a bin of a log with a low rate is one sample.
    found, index = np.unique((t / width).astype(int), return_inverse=True)
    used = len(found)
    return index, used, next((size for size in BINS if size >= used), used)


def sum_of_bins(index: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(T, ...) -> (U, ...) sums over the samples of each bin."""
    sums = [np.bincount(index, column) for column in x.reshape(len(x), -1).T]
    return np.stack(sums, -1).reshape(-1, *x.shape[1:])


def mean_of_bins(index: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(T, ...) -> (U, ...) means of the finite values in each bin, NaN = none."""
    known = np.isfinite(x)
    with np.errstate(invalid="ignore"):
        mean: np.ndarray = sum_of_bins(index, np.where(known, x, 0)) / sum_of_bins(index, known)
    return mean


def fill_up(x: np.ndarray, size: int, value: np.ndarray | float) -> np.ndarray:
    """(U, ...) -> (size, ...), padded with a value in all further rows."""
    return np.concatenate([x, np.broadcast_to(value, (size - len(x), *x.shape[1:]))])


def moving_mean(x: np.ndarray) -> np.ndarray:
    """(N, k) moving means over each row and the REACH rows around it."""
    padded = np.pad(x, ((REACH // 2 + 1, REACH // 2), (0, 0)), mode="edge").cumsum(0)
    return (padded[REACH + 1 :] - padded[: -REACH - 1]) / (REACH + 1)
