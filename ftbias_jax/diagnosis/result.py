"""Results of a diagnosis as plain tuples; report and command line read only these."""

import os
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ftbias_jax.io.log import Repairs
from ftbias_jax.io.write.provenance import Provenance
from ftbias_jax.setup.types import Setup

ALL_ALONG, AT_ONCE, GROWING = "all along", "at once", "growing"
"""How a cause begins."""

WANDER = "wander"
"""Form of the term for a bias that wanders more than the setup states."""

VERDICTS = ("none", "explained", "described", "partly_explained", "unknown")

Numbers: TypeAlias = "float | list[Numbers]"
"""A number, or nested lists of numbers in the shape of the catalogue's parameter."""


class Candidate(NamedTuple):
    """One effect that was fitted, alone or together with the causes named before it."""

    effect: str
    stage: str
    indistinguishable_from: tuple[str, ...]
    """Twins: effects that explain the log as well, within the error of the comparison."""
    separate_by: tuple[str, ...]
    """Measurement that would distinguish each of these twins ("" if none is known)."""
    parameters: dict[str, Numbers]
    """Parameter values in the units of the catalogue."""
    stderr: dict[str, Numbers]
    held_out_gain: float
    """Log-likelihood gain in nats per second of held-out log."""
    held_out_gain_stderr: float
    shrink: float
    """Share of the mean square gap that it removes, 0 to 1."""
    explanation: str
    remedy: str
    units: Mapping[str, str] = MappingProxyType({})  # units of the parameters; {} = unknown
    doubt: str = ""  # reason why it may be something else although it fits; "" = none
    nominal: Mapping[str, Numbers] = MappingProxyType({})  # values of the parameters that the setup states
    statement: str = ""  # the finding with its value in one sentence; "" = the name suffices
    behind: float = np.nan
    """nats per second by which it falls short of the best candidate, compared block by block; NaN = not compared."""
    behind_stderr: float = np.nan

    @property
    def title(self) -> str:
        """Name of the effect, with the joint's number if it belongs to one joint."""
        joint = self.parameters.get("joint")
        return self.effect if joint is None else f"{self.effect} (joint {joint:.0f})"


class Curve(NamedTuple):
    """Residual of the reading against a term's drive, and the contribution of the term."""

    drive: np.ndarray
    """(B,) the driving quantity, as coarse means."""
    drive_name: str
    """Name of the drive with its unit."""
    left: np.ndarray
    """(B,) N or Nm, residual without the term."""
    fitted: np.ndarray
    """(B,) N or Nm, contribution of the term."""
    left_name: str
    """Name of the residual's channel with its unit."""


class FoundTerm(NamedTuple):
    """Part of the gap that no effect of the catalogue explains, described by the quantity that drives it."""

    drive: str
    form: str
    frame: str
    acts_as: str
    text: str
    """Description in words and numbers."""
    coefficients: dict[str, Numbers]
    """Unit -> coefficient, or coefficients along the axes."""
    stderr: dict[str, Numbers]
    parameters: dict[str, Numbers]
    """Nonlinear parameters of the form, such as a time constant."""
    parameters_stderr: dict[str, Numbers]
    """Standard errors of the parameters and of the point."""
    point: list[float] | None
    """m, sensor frame, point of application of a force."""
    equivalent_to: tuple[str, ...]
    """Drives that describe the logs as well."""
    separate_by: tuple[str, ...]
    """Motion that would distinguish each of these drives."""
    resembles: tuple[str, ...]
    """Kinds of causes that look like this term."""
    check: str
    """What to inspect on the robot."""
    held_out_gain: float
    """Log-likelihood gain in nats per second of held-out log, over the model without the term."""
    held_out_gain_stderr: float
    shrink: float
    """Share of the whole gap on held-out blocks that it removes."""
    section: dict[str, Any]
    """The term as a section ``[[effects.term]]`` of a setup; for a bias that wanders, keys of its [bias]."""
    statement: str = ""
    """What acts, on what, and how much, in everyday words; "" = ``text``."""
    reading_stderr: list[float] | tuple[()] = ()
    """(6,) N, Nm, standard error of the reading due to the coefficients, root mean square over the logs; () = none."""
    curve: Curve | None = None


class Gap(NamedTuple):
    """Size of the gap: the part of the innovations that the stated noise does not account for."""

    before_rms: np.ndarray
    """(6,) N, Nm, rms of the held-out corrected wrench minus model."""
    after_rms: np.ndarray
    noise_floor: np.ndarray
    """(6,) N, Nm, rms due to noise alone."""
    before_sigmas: float
    after_sigmas: float
    shrink: float
    shrink_stderr: float


class Regime(NamedTuple):
    """State of the robot in which the gap occurs."""

    name: str
    share: float
    """Share of the gap's mean square in this regime."""
    expected: float  # share of the time spent in it, which chance would give


class Where(NamedTuple):
    """Location of the gap."""

    stages: tuple[str, ...]
    """Stages of the named causes, then of the next best candidates."""
    channels: dict[str, float]
    """Share of each channel in the mean square gap, in noise units; sums to 1."""
    intervals: tuple[tuple[float, float, float], ...]
    """(start s, end s, gap in noise sigmas) of the intervals with the largest gap."""
    regimes: tuple[Regime, ...]
    bands: tuple[tuple[float, float, float], ...]
    """(low Hz, high Hz, share of the gap's mean square) of each frequency band."""


class LogGap(NamedTuple):
    """Gap of one of several logs of the same robot."""

    name: str
    before_sigmas: float
    """Held-out rms of its innovations in noise sigmas, without the causes."""
    after_sigmas: float
    """Held-out rms with the causes, whose parameters all logs share."""
    own_gain: float
    """nats per second that separate parameters would gain in this log: large if the logs disagree."""
    parameters: dict[str, dict[str, Numbers]]
    """Effect -> the cause's parameters by this log alone."""
    stderr: dict[str, dict[str, Numbers]]
    nats: float = 0.0
    """Gain by the causes on the held-out blocks of this log; negative if the log contradicts them."""
    left: float = 0.0
    """nats per second that remain in this log; with parameters of its own it would gain ``own_gain`` of them."""

    @property
    def is_raised(self) -> bool:
        """Whether the causes add more than the noise to its error."""
        return self.after_sigmas**2 - self.before_sigmas**2 > 1


class Course(NamedTuple):
    """Time course of one cause over N logs of one robot, the latest of which were diagnosed together."""

    effect: str
    begins: str
    """``ALL_ALONG``, ``AT_ONCE`` or ``GROWING``."""
    since: float
    """s since 1970, date of the first log with the cause."""
    earliest: float
    """s since 1970: last log that is surely without it; with 95 % it began between here and ``latest``."""
    latest: float
    dates: np.ndarray
    """(N,) s since 1970, dates of the logs."""
    share: np.ndarray
    """(N,) size of the cause relative to the latest logs."""
    stderr: np.ndarray
    """(N,) standard error of the share."""
    before: float
    """Share before it began, which is a permanent error of the setup."""
    scatter: float
    """Standard deviation of the share from log to log, in addition to ``stderr``."""


class Series(NamedTuple):
    """Data of the plots, on a common coarse time axis."""

    t: np.ndarray
    """(B,) s."""
    before: np.ndarray
    """(B, 6) N, Nm, corrected wrench minus model without the causes."""
    after: np.ndarray
    """(B, 6) N, Nm, corrected wrench minus model with the causes."""
    noise: np.ndarray
    """(B, 6) N, Nm, standard deviation of these means due to noise alone."""
    regressor: np.ndarray
    """(B,) quantity through which the first cause acts, such as its predicted change of the wrench."""
    regressor_name: str
    refitted: np.ndarray | None = None
    """(B, 6) N, Nm, corrected wrench minus model without the causes, with the bias estimated by the model with them;
    without refitting, the bias filter absorbs part of a slow gap, which ``before`` then lacks. None = not known."""

    @property
    def whole(self) -> np.ndarray:
        """(B, 6) N, Nm, what the causes must explain: with the bias refitted where that is known."""
        return self.before if self.refitted is None else self.refitted


class Diagnosis(NamedTuple):
    """Complete diagnosis of one log or several logs of one robot."""

    verdict: str
    """One of VERDICTS."""
    sentence: str
    """Headline: what was found, how much it explains, and what to do."""
    causes: tuple[Candidate, ...]
    candidates: tuple[Candidate, ...]
    """All effects that were tried, best first."""
    gap: Gap
    where: Where
    not_tested: tuple[tuple[str, str], ...]
    """(effect, reason) of catalogue entries that these logs cannot test."""
    series: tuple[Series, ...]
    """Plot data, one per log."""
    logs: tuple[str, ...]
    """Names of the logs."""
    by_log: tuple[LogGap, ...] = ()
    """Gap of each of several logs separately; empty for a single one."""
    repairs: tuple[Repairs, ...] = ()
    """One per log: what was repaired or left out for the diagnosis, such as samples of an axis that stands still."""
    setup_name: str = ""
    """File name of the setup, for titles; "" = made in memory."""
    own_effects: tuple[Any, ...] = ()
    """User-defined ``Effect`` objects, for the setup that ``apply`` returns."""
    terms: tuple[FoundTerm, ...] = ()
    """Terms that describe what is not in the catalogue; best first."""
    provenance: Provenance | None = None
    """Origin of the diagnosis: its inputs."""
    note: str = ""
    """What of the setup was not used; "" = nothing."""
    correlations: np.ndarray = np.zeros((0, 0))
    """(P, P) correlations of the errors of all parameters of the causes, in their order: ``evidence.estimates``."""
    tool_stderr: Mapping[str, np.ndarray] = MappingProxyType({})
    """Standard errors of a tool that was fitted together with all causes, by keys of [tool]; {} = it was not fitted."""
    model_stderr: np.ndarray | None = None
    """(6,) N, Nm: standard error of the reading modelled with all causes, without ``tool_stderr``; None = not known."""
    courses: tuple[Course, ...] = ()
    """Time courses of causes over all logs, if more logs were given than were diagnosed together: ``pooled``."""
    command: str = ""
    """Command line that made it, for the report's advice; "" = built from names of logs and setup."""

    @property
    def losses(self) -> tuple[str, ...]:
        """One line for each kind of samples that was left out of the logs."""
        pairs = zip(self.logs, self.repairs, strict=False)
        return tuple(f"{log}: {repair.what}" for log, repairs in pairs for repair in repairs if repair.lost)

    # The package's __init__ binds the implementations of these and of __str__, which depend on this module.

    def to_html(self, path: str | os.PathLike[str], title: str = "") -> None:
        """Write a report with plots: ``report.html.save_html``."""
        raise NotImplementedError

    def to_json(self, path: str | os.PathLike[str]) -> None:
        """Write everything except the plot data, as JSON: ``report.as_json.save_json``."""
        raise NotImplementedError

    def apply(self, setup: Setup) -> Setup:
        """Setup with the causes and terms among its effects: ``apply.setup_with_causes``."""
        raise NotImplementedError
