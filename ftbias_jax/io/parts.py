"""Logs in parts, so that long ones need not fit in memory; faults of the whole log are known before the first part."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io import read_recorded
from ftbias_jax.io.check import check_content, check_samples, relative_seconds
from ftbias_jax.io.cleaning import Facts, Split, check_rest, findings, leave_out, slices, survey
from ftbias_jax.io.log import Log, Repairs
from ftbias_jax.io.remote import is_url
from ftbias_jax.io.stamps.clock import as_stamps
from ftbias_jax.io.stamps.steady import on_steady_clocks, scatters
from ftbias_jax.io.tables.array_files import stored_arrays
from ftbias_jax.io.tables.arrays import ARRAYS
from ftbias_jax.io.write.provenance import Source
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

LONG = 1 << 20
"""Number of samples from which an NPZ file is read in parts; the other formats are held in memory."""


class OpenLog(NamedTuple):
    """A log that can be filtered; samples of clipped and stuck axes are NaN."""

    length: int
    start: float
    """s, stamp of the first sample."""
    parts: Split
    facts: Facts
    repairs: Repairs
    source: Source
    """File and wrench stamps for the provenance of results."""
    frame: str = ""
    """The sensor's frame, as a recording of ROS names it."""
    salvaged: bool = False
    """Whether damaged parts of a recording were to be skipped."""
    acceleration_std: Array = np.zeros(3)
    """See ``Log.acceleration_std``."""

    def whole(self) -> Log:
        """The whole log in memory."""
        log = next(self.parts(self.length))
        log = log._replace(repairs=self.repairs, file=self.source.file, frame=self.frame)
        return log._replace(acceleration_std=self.acceleration_std)


def open_log(path: str | os.PathLike[str], setup: Setup, *, salvage: bool = False) -> OpenLog:
    """Open a log of any format; samples of clipped and stuck axes are left out and counted. Errors as ``read_log``."""
    file = os.fspath(path)
    usual = not setup.pose and setup.log.time_unit is None and setup.log.rate is None and setup.log.one_clock
    usual = usual and setup.log.wrench_axes == "sensor" and not setup.log.files and not is_url(file)
    usual = usual and not setup.log.columns
    opened = _open_npz(file, setup) if usual and Path(file).suffix.lower() == ".npz" else None
    if opened is None:
        log = read_recorded(path, setup, salvage=salvage)
        length, start, split, repairs, frame = len(log.t), log.start, slices(log), log.repairs, log.frame
        uncertain = log.acceleration_std
    else:
        (length, start, split), repairs, frame, uncertain = opened, (), "", np.zeros(3)
    facts = survey(split)
    check_content(~np.isnan(facts.first_q), facts.wrench_t, setup, file=file)
    check_rest(facts, clipped=True, stuck=True, file=file)

    def cleaned(size: int) -> Iterator[Log]:
        return (leave_out(part, facts) for part in split(size))

    source = Source(file, facts.wrench_t, start)
    return OpenLog(length, start, cleaned, facts, (*repairs, *findings(facts)), source, frame, salvage, uncertain)


def _open_npz(file: str, setup: Setup) -> tuple[int, float, Split] | None:
    """Length, start and parts of a long NPZ file with one clock; None for any other file, and for unsorted stamps."""
    stored = stored_arrays(file, {*ARRAYS})
    names = [name for name in ("q", "dq", "wrench", "temperature") if name in stored]
    one_clock = {"t", "q", "wrench"} <= stored.keys() and not {"t_joints", "t_wrench"} & stored.keys()
    if not one_clock or stored["t"].shape < (LONG,):
        return None
    stamps = as_stamps(next(stored["t"].parts(stored["t"].shape[0])), file=file)
    if (stamps[1:] <= stamps[:-1]).any():
        return None  # a log that must be sorted is held in memory
    t, start = relative_seconds(stamps, file=file)
    for name in names:
        if stored[name].shape[:1] != t.shape:
            message = f"has shape {stored[name].shape} for {len(t)} stamps"
            raise LogError(message, file=file, field=name, remedy="give one sample per stamp")
    begin: dict[str, Array] = {name: next(stored[name].parts(LONG)) for name in names} if scatters(stamps) else {}
    if begin and on_steady_clocks(stamps[:LONG], begin, file)[1]:
        return None  # so is one whose stamps must be corrected

    def split(size: int) -> Iterator[Log]:
        columns = zip(*(stored[name].parts(size) for name in names), strict=True)
        for first, values in zip(range(0, len(t), size), columns, strict=True):
            part = dict(zip(names, values, strict=True))
            times = t[first : first + size]
            dq = part["dq"] if "dq" in part else np.full(part["q"].shape, np.nan)
            temperature = part["temperature"] if "temperature" in part else np.full(len(times), np.nan)
            log = Log(times, part["q"], dq, part["wrench"], temperature, start)
            yield check_samples(log, setup, file=file, first=first)

    return len(t), start, split
