"""What a diagnosis says, as plain bundles; report and command line read only this."""

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
"""Form of the term that is a bias which wanders more than the setup states."""

VERDICTS = ("none", "explained", "described", "partly_explained", "unknown")

Numbers: TypeAlias = "float | list[Numbers]"
"""A number, or lists of them in the shape of the catalogue's parameter."""


class Candidate(NamedTuple):
    """One effect that was fitted, alone or on top of those named before it."""

    effect: str
    stage: str
    indistinguishable_from: tuple[str, ...]
    """Effects that explain the log as well, within the error of the comparison."""
    separate_by: tuple[str, ...]
    """The measurement that would tell them apart, one for each of the above ("" if none is known)."""
    parameters: dict[str, Numbers]
    """In the units of the catalogue."""
    stderr: dict[str, Numbers]
    held_out_gain: float
    """nats per second of log that the fit has not seen."""
    held_out_gain_stderr: float
    shrink: float
    """Share of the mean square gap it removes, 0 to 1."""
    explanation: str
    remedy: str
    units: Mapping[str, str] = MappingProxyType({})  # of the parameters; {} = not known
    doubt: str = ""  # why it may be something else, although it fits; "" = no reason
    nominal: Mapping[str, Numbers] = MappingProxyType({})  # the setup's values of parameters that it states
    statement: str = ""  # what was found, in one sentence with its value; "" = the name says it
    behind: float = np.nan
    """nats per second that it gains less than the best of the ranking, block by block; NaN = not compared."""
    behind_stderr: float = np.nan

    @property
    def title(self) -> str:
        """The effect, with the joint's number if it is of one joint."""
        joint = self.parameters.get("joint")
        return self.effect if joint is None else f"{self.effect} (joint {joint:.0f})"


class Curve(NamedTuple):
    """What was left of the reading against a term's drive, and what the term adds."""

    drive: np.ndarray
    """(B,) the quantity, at coarse means."""
    drive_name: str
    """With its unit."""
    left: np.ndarray
    """(B,) N or Nm, without the term."""
    fitted: np.ndarray
    """(B,) N or Nm, of the term."""
    left_name: str
    """With its unit."""


class FoundTerm(NamedTuple):
    """A part of the gap that no effect of the catalogue explains, described by what drives it."""

    drive: str
    form: str
    frame: str
    acts_as: str
    text: str
    """In words and numbers."""
    coefficients: dict[str, Numbers]
    """Unit -> number, or numbers along the axes."""
    stderr: dict[str, Numbers]
    parameters: dict[str, Numbers]
    """What the form is not linear in, such as a time constant."""
    parameters_stderr: dict[str, Numbers]
    """Of these, and of the point."""
    point: list[float] | None
    """m, sensor frame, where a force acts."""
    equivalent_to: tuple[str, ...]
    """Drives that describe the logs as well."""
    separate_by: tuple[str, ...]
    """The motion that would tell each of them apart."""
    resembles: tuple[str, ...]
    """Kinds of causes that look so."""
    check: str
    """What to look at on the robot."""
    held_out_gain: float
    """nats per second of log that the fit has not seen, over the model without it."""
    held_out_gain_stderr: float
    shrink: float
    """Its share of the whole gap on held-out blocks."""
    section: dict[str, Any]
    """The term as a section ``[[effects.term]]`` of a setup; of a bias that wanders keys of its [bias]."""
    statement: str = ""
    """What acts, how much and on what, in everyday words; "" = ``text``."""
    curve: Curve | None = None


class Gap(NamedTuple):
    """Size of the gap: the part of the innovations that the stated noise does not account for."""

    before_rms: np.ndarray
    """(6,) N, Nm, corrected wrench minus model, held out."""
    after_rms: np.ndarray
    noise_floor: np.ndarray
    """(6,) N, Nm, what noise alone leaves."""
    before_sigmas: float
    after_sigmas: float
    shrink: float
    shrink_stderr: float


class Regime(NamedTuple):
    """Where in the state of the robot the gap is."""

    name: str
    share: float
    """Of the gap's mean square that lies there."""
    expected: float  # share of the time spent there: what chance would give


class Where(NamedTuple):
    """Location of the gap."""

    stages: tuple[str, ...]
    """Stages of the named causes, then of the next best candidates."""
    channels: dict[str, float]
    """Share of each channel of the mean square gap, in noise units; sums to 1."""
    intervals: tuple[tuple[float, float, float], ...]
    """Start s, end s, and gap in noise sigmas, where it is largest."""
    regimes: tuple[Regime, ...]
    bands: tuple[tuple[float, float, float], ...]
    """Low Hz, high Hz, and share of the gap's mean square."""


class LogGap(NamedTuple):
    """One log of several of the same robot."""

    name: str
    before_sigmas: float
    """Held-out rms of its innovations in noise sigmas, without the causes."""
    after_sigmas: float
    """The same with the causes, whose parameters all logs share."""
    own_gain: float
    """nats per second that parameters of its own would gain in it: large if the logs disagree."""
    parameters: dict[str, dict[str, Numbers]]
    """effect -> the cause's parameters by this log alone."""
    stderr: dict[str, dict[str, Numbers]]


class Course(NamedTuple):
    """How one cause went on over N logs of one robot, of which the latest were diagnosed together."""

    effect: str
    begins: str
    """``ALL_ALONG``, ``AT_ONCE`` or ``GROWING``."""
    since: float
    """s since 1970, of the first log that has it."""
    earliest: float
    """s since 1970: with 95 % it began between here, the last log that is sure to be without it, and ``latest``."""
    latest: float
    dates: np.ndarray
    """(N,) s since 1970, of the logs."""
    share: np.ndarray
    """(N,) of what it is in the latest logs."""
    stderr: np.ndarray
    """(N,)."""
    before: float
    """Its share before it began: what the setup had wrong all along."""
    scatter: float
    """Standard deviation of its share from log to log, beside ``stderr``."""


class Series(NamedTuple):
    """What the plots show, on a common coarse time axis."""

    t: np.ndarray
    """(B,) s."""
    before: np.ndarray
    """(B, 6) N, Nm, corrected wrench minus model without the causes."""
    after: np.ndarray
    """(B, 6) the same with the causes in the model."""
    noise: np.ndarray
    """(B, 6) N, Nm, standard deviation of these means by noise alone."""
    regressor: np.ndarray
    """(B,) the quantity the first cause acts through, such as its own predicted change of the wrench."""
    regressor_name: str
    refitted: np.ndarray | None = None
    """(B, 6) N, Nm, corrected wrench minus model without the causes, with the bias that the model with them leaves; the
    bias filter follows a part of a slow gap, which ``before`` then lacks. None = not known."""

    @property
    def whole(self) -> np.ndarray:
        """(B, 6) N, Nm, what the causes must explain: with the bias refitted where that is known."""
        return self.before if self.refitted is None else self.refitted


class Diagnosis(NamedTuple):
    """The whole answer for one log or several of one robot."""

    verdict: str
    """One of VERDICTS."""
    sentence: str
    """The headline: what was found, what it is worth, what to do."""
    causes: tuple[Candidate, ...]
    candidates: tuple[Candidate, ...]
    """Everything that was tried, best first."""
    gap: Gap
    where: Where
    not_tested: tuple[tuple[str, str], ...]
    """(effect, why) of entries of the catalogue that this log cannot speak about."""
    series: tuple[Series, ...]
    """One a log."""
    logs: tuple[str, ...]
    """Names of the logs."""
    by_log: tuple[LogGap, ...] = ()
    """Each of several logs by itself; empty for a single one."""
    repairs: tuple[Repairs, ...] = ()
    """One a log: what was mended or left out to diagnose it, such as the samples of an axis that stands still."""
    setup_name: str = ""
    """The file name of the setup, for titles; "" = from memory."""
    own_effects: tuple[Any, ...] = ()
    """``Effect`` objects that the caller brought, for the setup that ``apply`` makes."""
    terms: tuple[FoundTerm, ...] = ()
    """What is not in the catalogue, described; best first."""
    provenance: Provenance | None = None
    """What it was made from."""
    note: str = ""
    """What of the setup was not used; "" = nothing."""
    correlations: np.ndarray = np.zeros((0, 0))
    """(P, P) between the errors of all numbers of the causes, in their order: ``evidence.estimates``."""
    tool_stderr: Mapping[str, np.ndarray] = MappingProxyType({})
    """Standard errors of a tool that was fitted beside all causes, by keys of [tool]; {} = it was not."""
    model_stderr: np.ndarray | None = None
    """(6,) N, Nm: of the reading of the model with all causes, but for what ``tool_stderr`` says; None = not known."""
    courses: tuple[Course, ...] = ()
    """How causes went on over all logs, where more than those that were diagnosed were given: ``pooled``."""
    command: str = ""
    """What was typed to make it, for the report's advice; "" = made from names of logs and setup."""

    @property
    def losses(self) -> tuple[str, ...]:
        """One line for every kind of samples that were left out of the logs."""
        pairs = zip(self.logs, self.repairs, strict=False)
        return tuple(f"{log}: {repair.what}" for log, repairs in pairs for repair in repairs if repair.lost)

    # The room's __init__ binds the functions that these and __str__ are: they are made of what this module defines.

    def to_html(self, path: str | os.PathLike[str], title: str = "") -> None:
        """Write a report with plots: ``report.html.save_html``."""
        raise NotImplementedError

    def to_json(self, path: str | os.PathLike[str]) -> None:
        """Write all but the plots' series, for programs: ``report.as_json.save_json``."""
        raise NotImplementedError

    def apply(self, setup: Setup) -> Setup:
        """A setup with the causes and terms among its effects: ``apply.setup_with_causes``."""
        raise NotImplementedError
