"""What filtering and smoothing a log from a setup gives back, in memory."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from ftbias_jax.errors import UsageError
from ftbias_jax.filtering.noise.log_noise import LogNoise, describe
from ftbias_jax.filtering.quality.consistency import Consistency, check
from ftbias_jax.filtering.quality.contacts import ContactInterval
from ftbias_jax.filtering.quality.spectrum import Line, find_lines
from ftbias_jax.filtering.quality.summary import Summary, format_summary
from ftbias_jax.filtering.verbs.forecast import Forecast, forecast
from ftbias_jax.io.log import Repairs
from ftbias_jax.io.write import save_results
from ftbias_jax.io.write.provenance import Provenance
from ftbias_jax.io.write.selection import About, Selection
from ftbias_jax.model.kinematics.recorded_pose import FreeBody
from ftbias_jax.model.params import Params
from ftbias_jax.types import Array


class Saved:
    """What can be written to a file."""

    frame: str
    provenance: Provenance | None
    contacts: tuple[ContactInterval, ...] = ()

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        fields: Sequence[str] = (),
        precision: str = "single",
        every: int = 1,
        rate: float | None = None,
    ) -> None:
        """Write the arrays, whole or not at all; those of a filter are the file that ``ftbias filter`` writes.

        Samples are left out, never averaged: what is written of the others is what the filter computed from all of
        them. Estimates lose nothing by that; of the reading (wrench_unbiased, contact_wrench, innovation) vibration
        above half the output's rate folds to lower frequencies.

        Args:
            path: the file; its suffix names the format: .npz, .csv, .parquet or .mcap.
            fields: names of the arrays to write, to which t is added; () = all.
            precision: "single" (float32, seven digits; t and the log likelihood are double all the same) or "double".
            every: write each sample of so many, from the first on.
            rate: Hz, instead: write the first sample at or after each tick of such a clock.

        Raises:
            UsageError: no format has this suffix, a field does not exist, or a number is impossible. OutputError: the
                file cannot be written, or a package is missing.
        """
        selection = Selection(tuple(fields), precision, every, rate)
        contacts = [contact.plain() for contact in self.contacts]
        save_results(path, _arrays(self), About(self.frame, self.provenance, contacts, selection))


@dataclass(frozen=True, eq=False)
class FilterResult(Saved):
    """Result of filtering a log, at the stamps where any wrench axis was measured.

    numpy arrays in float64; wrenches are in the sensor frame and act on the tool: unbiased = measured + bias. Effects
    that the setup states are in wrench_tool, those of the bias (warming up, temperature) in bias.
    """

    t: Array
    """(T,) s, as recorded."""
    bias: Array
    """(T, 6) N, Nm."""
    drift: Array
    """(T, 6) N/s, Nm/s, the bias's rate of change."""
    bias_std: Array
    """(T, 6) N, Nm, standard deviation."""
    drift_std: Array
    """(T, 6) N/s, Nm/s, standard deviation."""
    wrench_unbiased: Array
    """(T, 6) N, Nm, measured + bias; NaN = not measured."""
    q: Array
    """(T, n) rad (m for prismatic joints), filtered joint positions."""
    dq: Array
    """(T, n) rad/s (m/s)."""
    ddq: Array
    """(T, n) rad/s^2 (m/s^2)."""
    ddq_std: Array
    """(T, n) rad/s^2 (m/s^2), standard deviation."""
    wrench_tool: Array
    """(T, 6) N, Nm, what the tool must cause by its weight and motion."""
    innovation: Array
    """(T, 6) N, Nm, the tool's wrench minus the corrected reading, predicted; NaN = not used."""
    nis: Array
    """(T,) normalised innovation squared, summed over the axes that were used."""
    log_likelihood: Array
    """() nats, of joints and wrench."""
    innovation_std: Array
    """(T, 6) N, Nm, standard deviation: the filter's, with the noise of samples that the log shows."""
    params: Params
    """The parameters that the filter used; arrays of JAX."""
    noise: LogNoise
    """What the log shows of contact and noise beyond its setup."""
    joint_model: str
    """Key of process_models.JOINT_MODELS."""
    repairs: Repairs
    """What was left out of the log, and what its owner should know."""
    start: float
    """s, stamp of the log's first sample."""
    summary: Summary
    """The numbers that ``print`` shows."""
    warnings: tuple[str, ...] = ()
    """Mistakes of the setup that the log shows, or that the gate keeps out most of the log; a line each."""
    used: Array | None = None
    """(T,) whether the sample passed the gate, and nothing touched the tool."""
    reading_std: Array | None = None
    """(T, 6) N, Nm: how far a reading is off wrench_tool - bias by all its noise, white and correlated."""
    slow_error: Array | None = None
    """(T, 6) N, Nm: of wrench_tool - reading what is correlated noise, not bias; None if filtered as stated."""
    contact_wrench: Array | None = None
    """(T, 6) N, Nm, sensor frame: what the environment exerts on the tool; None if filtered as stated."""
    contact_wrench_std: Array | None = None
    """(T, 6) N, Nm, standard deviation: of bias and reading together."""
    in_contact: Array | None = None
    """(T,) whether the sample is in an interval of contact."""
    bias_smooth: Array | None = None
    """(T, 6) N, Nm, bias given the whole log; None if not asked for."""
    drift_smooth: Array | None = None
    """(T, 6) N/s, Nm/s, drift given the whole log."""
    bias_smooth_std: Array | None = None
    """(T, 6) N, Nm, standard deviation."""
    drift_smooth_std: Array | None = None
    """(T, 6) N/s, Nm/s, standard deviation."""
    contacts: tuple[ContactInterval, ...] = ()
    """Intervals in which something touches the tool: their wrench and its error."""
    frame: str = ""
    """The sensor's frame, as a recording of ROS names it."""
    provenance: Provenance | None = None
    """What it was made from, as files say it."""

    def forecast(self, seconds: float) -> Forecast:
        """What wrench_tool - reading should be so many seconds after each sample, with its standard deviation.

        Args:
            seconds: 0 or more.
        """
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
        told = [*self.warnings, format_summary(self.summary), *describe(self.noise)]
        lines = [*told, format_joint_noise(self.params, self.joint_model)]
        return "\n".join(lines)


def format_joint_noise(params: Params, joint_model: str) -> str:
    """One line with the process noise of the joints, or of the pose, that the filter took."""
    density, what = np.asarray(params.joint.process_density), "pose" if isinstance(params.arm, FreeBody) else "joint"
    return f"{what} process noise ({joint_model}): {' '.join(f'{x:.3g}' for x in density)}"


def _arrays(result: Any) -> dict[str, Array]:
    """The named arrays of a result, as they stand in a file."""
    named = {field.name: getattr(result, field.name) for field in fields(result)}
    return {name: value for name, value in named.items() if isinstance(value, np.ndarray | np.generic)}


ARRAYS = tuple(
    field.name for field in fields(FilterResult) if field.type in ("Array", "Array | None") and field.name != "t"
)
"""Names of the arrays of a result beside t."""


def require_fields(names: Sequence[str]) -> None:
    """Refuse names that no array of a result has.

    Raises:
        UsageError: naming the first of them.
    """
    for name in names:
        if name not in (*ARRAYS, "t"):
            raise UsageError(f"there is no field {name!r}", field="fields", remedy=f"choose from {', '.join(ARRAYS)}")


def only(result: FilterResult, names: Sequence[str]) -> FilterResult:
    """The result with t, log_likelihood and the arrays so named; () = with all."""
    left_out = {*ARRAYS} - {*names, "log_likelihood"} if names else set[str]()
    nothing: dict[str, Any] = dict.fromkeys(left_out)
    return replace(result, **nothing)


def _require(result: FilterResult, what: str, names: Sequence[str]) -> None:
    if missing := [name for name in names if getattr(result, name) is None]:
        remedy = f"name {', '.join(missing)} in fields of filter_log"
        raise UsageError(f"{what} needs {missing[0]}, which was not kept", field="fields", remedy=remedy)
