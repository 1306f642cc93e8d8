"""Samples averaged over short bins, and bins filled up to few lengths."""

import numpy as np

SHORTEST_BIN = 0.01
"""s; a 25 Hz ringing of the tool is still seen."""
BINS = (1024, 2048, 4096, 8192)
"""Lengths that binned logs are padded to, so that they share compiled programs."""
MOST_BINS = 4096
"""Longer logs get longer bins."""


def bins_of(t: np.ndarray, duration: float) -> tuple[np.ndarray, int, int]:
    """The bin (T,) of every sample with a measurement, how many bins there are, and how many with their padding.

    Args:
        t: (T,) s, stamps of the samples.
        duration: s, of the log.
    """
    width = max(SHORTEST_BIN, np.nextafter(duration / MOST_BINS, np.inf))  # so that the last sample is in the last bin
    # Bins without a sample are left out: a bin of a slow log is a sample.
    found, index = np.unique((t / width).astype(int), return_inverse=True)
    used = len(found)
    return index, used, next((size for size in BINS if size >= used), used)


def sum_of_bins(index: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(T, ...) -> (U, ...) sums over the samples of each bin."""
    sums = [np.bincount(index, column) for column in x.reshape(len(x), -1).T]
    return np.stack(sums, -1).reshape(-1, *x.shape[1:])


def mean_of_bins(index: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(T, ...) -> (U, ...) means of what is known in each bin, NaN = nothing."""
    known = np.isfinite(x)
    with np.errstate(invalid="ignore"):
        mean: np.ndarray = sum_of_bins(index, np.where(known, x, 0)) / sum_of_bins(index, known)
    return mean


def fill_up(x: np.ndarray, size: int, value: np.ndarray | float) -> np.ndarray:
    """(U, ...) -> (size, ...) with a value in all further rows."""
    return np.concatenate([x, np.broadcast_to(value, (size - len(x), *x.shape[1:]))])
