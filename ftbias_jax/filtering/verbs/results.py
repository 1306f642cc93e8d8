"""Results of filtering and smoothing one log or many logs from a setup, in memory."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from ftbias_jax.check.result import Check
from ftbias_jax.errors import UsageError, is_number
from ftbias_jax.filtering.noise.log_noise import LogNoise, describe, remarks_of_noise
from ftbias_jax.filtering.quality.ahead import Forecast, forecast
from ftbias_jax.filtering.quality.consistency import Consistency, check
from ftbias_jax.filtering.quality.contacts import ContactInterval
from ftbias_jax.filtering.quality.spectrum import Line, find_lines
from ftbias_jax.filtering.quality.summary import Summary, format_summary, worse_than_raw
from ftbias_jax.filtering.result import ARRAYS, Filtered, named_arrays
from ftbias_jax.io.log import Repairs
from ftbias_jax.io.write import save_results
from ftbias_jax.io.write.provenance import Provenance
from ftbias_jax.io.write.selection import About, Selection, names_of
from ftbias_jax.model.kinematics.recorded_pose import FreeBody
from ftbias_jax.model.params import Params
from ftbias_jax.runtime.many import Results


@dataclass(frozen=True, eq=False, kw_only=True)
class FilterResult(Filtered):
    """Result of filtering a log: the arrays of ``Filtered``, in float64, with parameters, noise, summary and checks."""

    params: Params
    """Parameters that the filter used; JAX arrays."""
    noise: LogNoise
    """Contact and noise that the log shows beyond its setup."""
    joint_model: str
    """Key of process_models.JOINT_MODELS."""
    repairs: Repairs
    """What was left out of the log, and remarks for its owner."""
    start: float
    """s, stamp of the log's first sample."""
    summary: Summary
    """The numbers that ``print`` shows."""
    checked: Check
    """Mistakes of the setup that the log shows; none if this was not checked."""
    contacts: tuple[ContactInterval, ...] = ()
    """Intervals in which something touches the tool, with their wrench and its error."""
    frame: str = ""
    """Frame of the sensor as named in a ROS recording."""
    provenance: Provenance | None = None
    """Origin of the result, as written to files."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Mistakes of the setup that the log shows, a log without free motion, a gate that keeps out most of it."""
        return (*self.checked.lines(), *(repair.what for repair in remarks_of_noise(self.noise) if repair.lost))

    @property
    def worse_than_raw(self) -> bool:
        """Whether the corrected wrench is worse than the raw one."""
        return self.checked.worse_than_raw or worse_than_raw(self.summary)

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        fields: Sequence[str] = (),
        precision: str = "single",
        every: int = 1,
        rate: float | None = None,
    ) -> None:
        """Write the arrays, whole or not at all; those of a filter make the file that ``ftbias filter`` writes.

        Samples are left out, never averaged: the others are written as the filter computed them from all samples.
        Estimates lose nothing by that; in the reading (wrench_unbiased, contact_wrench, innovation), vibration above
        half the output's rate aliases to lower frequencies.

        Args:
            path: the file; its suffix names the format: .npz, .csv, .parquet or .mcap.
            fields: names of the arrays to write, to which t is added; () = all.
            precision: "single" (float32, seven digits; t and the log likelihood are double all the same) or "double".
            every: write one sample out of this many, starting with the first.
            rate: Hz, instead: write the first sample at or after each tick of a clock of this rate.

        Raises:
            UsageError: no format has this suffix, a field does not exist, or a number is impossible. OutputError: the
                file cannot be written, or a package is missing.
        """
        selection = Selection(names_of(fields), precision, every, rate)
        contacts = [contact.plain() for contact in self.contacts]
        save_results(path, named_arrays(self), About(self.frame, self.provenance, contacts, selection))

    def forecast(self, seconds: float) -> Forecast:
        """Expected wrench_tool - reading this many seconds after each sample, with its standard deviation.

        Args:
            seconds: 0 or more.

        Raises:
            UsageError: the number is negative, or the result has not all the arrays that this needs.
        """
        if not is_number(seconds, 0.0):
            raise UsageError(f"{seconds} s", field="seconds", remedy="give 0 or more")
        _require(self, "forecast", ("bias", "drift", "bias_std", "drift_std", "innovation_std"))
        return forecast(self, seconds)

    def check(self) -> Consistency:
        """Whether the error bars are right: innovations against their chi-square bounds, and their whiteness."""
        _require(self, "check", ("innovation", "innovation_std"))
        return check(self.innovation, (self.innovation / self.innovation_std) ** 2)

    def lines(self) -> list[Line]:
        """Hum and resonances: peaks in the spectrum of the innovations, strongest first; white noise has none."""
        _require(self, "lines", ("innovation",))
        return find_lines(self.t, self.innovation)

    def __str__(self) -> str:
        return "\n".join([*self.warnings, self.numbers()])

    def numbers(self) -> str:
        """What ``print`` shows beside the warnings: summary, noise and contact of the log, joints' process noise."""
        what = "pose" if isinstance(self.params.arm, FreeBody) else "joint"
        density = " ".join(f"{float(x):.3g}" for x in self.params.joint.process_density)
        of_joints = f"{what} process noise ({self.joint_model}): {density}"
        return "\n".join([format_summary(self.summary), *describe(self.noise), of_joints])


def require_fields(names: Sequence[str]) -> None:
    """Refuse names that no array of a result has.

    Raises:
        UsageError: naming the first of them.
    """
    for name in names:
        if name not in ARRAYS:
            remedy = f"choose from {', '.join(ARRAYS[1:])}"
            raise UsageError(f"there is no field {name!r}", field="fields", remedy=remedy)


def only(result: FilterResult, names: Sequence[str]) -> FilterResult:
    """The result with only t, log_likelihood and the named arrays; () = all arrays."""
    left_out = {*ARRAYS} - {*names, "t", "log_likelihood"} if names else set[str]()
    nothing: dict[str, Any] = dict.fromkeys(left_out)
    return replace(result, **nothing)


def _require(result: FilterResult, what: str, names: Sequence[str]) -> None:
    if missing := [name for name in names if getattr(result, name) is None]:
        remedy = f"name {', '.join(missing)} in fields of filter_log"
        raise UsageError(f"{what} needs {missing[0]}, which was not kept", field="fields", remedy=remedy)


class FilterResults(Results[FilterResult]):
    """A sequence of results in the order of the logs; None = the log could not be filtered, ``errors`` states why."""

    def __str__(self) -> str:
        done = [result for result in self.results if result is not None]
        samples, seconds = sum(len(x.t) for x in done), sum(x.summary.seconds for x in done)
        lines = [f"{len(done)} of {len(self)} logs filtered: {samples} wrench samples, {seconds:.1f} s"]
        lines += [f"log {i}: {line}" for i, x in enumerate(self.results) if x is not None for line in x.warnings]
        return "\n".join([*lines, *self.failed()])
