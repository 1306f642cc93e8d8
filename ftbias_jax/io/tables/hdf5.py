"""Logs as HDF5 files: datasets with the names of the native format, at the root."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.limits.budget import Budget
from ftbias_jax.io.limits.hdf5_chunks import check_chunks
from ftbias_jax.io.log import Log
from ftbias_jax.io.tables.arrays import ARRAYS, POSE_ARRAYS, by_native_names, log_from_arrays, wanted_arrays
from ftbias_jax.io.unpack import need
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array


def read_hdf5(path: str | os.PathLike[str], setup: Setup) -> Log:
    """Read the arrays of ``log_from_arrays``; other datasets are ignored."""
    arrays = by_native_names(load_hdf5(path, wanted_arrays(setup)), setup, os.fspath(path))
    return log_from_arrays(arrays, setup, os.fspath(path))


def load_hdf5(path: str | os.PathLike[str], names: Sequence[str] = (*ARRAYS, *POSE_ARRAYS)) -> dict[str, Array]:
    """The datasets of a log by name; those that are not there are left out."""
    with _opened(os.fspath(path), names) as datasets:
        return {name: np.asarray(dataset[()]) for name, dataset in datasets.items()}


def dataset_shapes(path: str | os.PathLike[str]) -> dict[str, tuple[int, ...]]:
    """The shapes of the datasets of a log by name."""
    with _opened(os.fspath(path)) as datasets:
        return {name: dataset.shape for name, dataset in datasets.items()}


@contextmanager
def _opened(file: str, names: Sequence[str] = (*ARRAYS, *POSE_ARRAYS)) -> Iterator[dict[str, Any]]:
    """The datasets of a log, none of which takes more than it may; what h5py raises as errors of ours."""
    h5py = need("h5py", "hdf5", file)
    budget = Budget(file)
    try:
        with open(file, "rb"):  # the system's own words for a file that may not be read
            pass
        with h5py.File(file, "r") as root:
            datasets = {name: _dataset(h5py, root, name, file) for name in names if name in root}
            for name, dataset in datasets.items():
                budget.hold(dataset.size * 8, name)
            for name, dataset in datasets.items():
                check_chunks(dataset, budget, file, name)
            yield datasets
    except LogError:
        raise
    except OSError as error:
        words = error.strerror or str(error).partition("(")[2].rstrip(")") or error
        raise LogError(f"cannot be read: {words}", file=file, remedy="check the path and the file") from error
    except Exception as error:  # h5py turns what the C library reports into many types, RuntimeError among them
        raise LogError(f"is damaged: {error}", file=file, remedy="write it again") from error


def _dataset(h5py: Any, root: Any, name: str, file: str) -> Any:
    """The dataset of this name, if its numbers are in this very file and as many as it has room for."""
    if not isinstance(root.get(name, getlink=True), h5py.HardLink):
        raise LogError("is a link", file=file, field=name, remedy="store the dataset itself at the root")
    dataset = root[name]
    if not isinstance(dataset, h5py.Dataset) or dataset.dtype.kind not in "fiu" or dataset.shape is None:
        raise LogError("is no dataset of numbers", file=file, field=name, remedy="store arrays of real numbers")
    if dataset.is_virtual or dataset.external:
        raise LogError("is stored in another file", file=file, field=name, remedy="store the dataset itself")
    return dataset
