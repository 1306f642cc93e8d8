"""Columns of a log beside joints, wrench and temperature: what the setup names in [log.columns], for effects to see."""

from __future__ import annotations

import os
from collections.abc import Mapping

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.clock import as_stamps, since, tidy
from ftbias_jax.io.conventions.units import later, recorded_times
from ftbias_jax.io.log import Column, Log
from ftbias_jax.io.remote.fetch import opened
from ftbias_jax.io.tables import arrays
from ftbias_jax.io.tables.arrays import TABLES, suffix_of
from ftbias_jax.io.tables.grouping import files_of
from ftbias_jax.io.tables.streams import setup_of_file
from ftbias_jax.setup.keys.table import further_columns
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array


def with_extra_columns(log: Log, path: str | os.PathLike[str], setup: Setup) -> Log:
    """The log with the further columns that the setup names."""
    wanted = further_columns(setup.log.columns)
    if not wanted:
        return log
    if not setup.log.files:
        return log._replace(columns=_columns_of(os.fspath(path), wanted, log.start, setup, "wrench"))
    files = files_of(path, setup.log.files)
    columns = {name: _in_one_of(files, name, there, log.start, setup) for name, there in wanted.items()}
    return log._replace(columns=columns)


def _in_one_of(files: Mapping[str, str], name: str, there: str, start: float, setup: Setup) -> Column:
    """A column from the first of the files that has it."""
    errors = []
    for key, file in files.items():
        try:
            with opened(file) as copy:
                return _columns_of(copy, {name: there}, start, setup_of_file(setup, key), key)[name]
        except LogError as error:
            errors.append(error)
    raise errors[-1]


def _columns_of(file: str, wanted: Mapping[str, str], start: float, setup: Setup, clock: str) -> dict[str, Column]:
    """Columns of one file; ``clock`` is the stream of which [log.time_offsets] holds."""
    if suffix_of(file) not in TABLES:
        message = f"[log.columns] of the setup names {next(iter(wanted))}, but a recording of ROS has no columns"
        raise LogError(message, file=file, remedy="write the log as .npz, .csv or .parquet")
    stamps, found = arrays.further_columns(file, setup, tuple(wanted.values()))
    times = as_stamps(recorded_times({"t": stamps, "wrench": stamps}, setup.log), file=file)
    times = later(times, setup.log.time_offsets.get(clock, 0.0))
    return {name: column_of(times, found[there], start, file, there) for name, there in wanted.items()}


def column_of(stamps: Array, values: Array, start: float, file: str = "", field: str = "") -> Column:
    """The values (T,) that were measured, with stamps in s since the first sample of the log.

    The stamps (T,) are floating point in s or integers in ns, as ``start``, that of the first sample, is in s.
    """
    t, values = as_stamps(stamps, file=file), np.asarray(values)
    if values.shape != t.shape or values.dtype.kind not in "fiu":
        message = f"has shape {values.shape} and type {values.dtype} for {len(t)} stamps"
        raise LogError(message, file=file, field=field, remedy="give one real number per stamp, NaN = not measured")
    values = values.astype(float)
    if np.isinf(values).any():
        raise LogError("is infinite", file=file, field=field, remedy="write NaN where nothing was measured")
    known = np.isfinite(values)
    if not known.any():
        raise LogError("was never measured", file=file, field=field, remedy="leave it out of [log.columns]")
    ordered = tidy(since(t, start)[known], values[known, None])
    return Column(ordered.t, ordered.values[:, 0])
