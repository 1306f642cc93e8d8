"""Result of a setup check, as text and as JSON."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from ftbias_jax.errors import FtbiasError, LogError, SetupError
from ftbias_jax.io.atomic import write_json
from ftbias_jax.io.write.provenance import Provenance

MISTAKES: Mapping[str, str] = {
    "sign": "the sensor reports the opposite sign",
    "gravity": "gravity points another way in the base frame",
    "wrench_units": "force or torque are in other units than N and Nm",
    "tool_units": "the tool's mass or lengths are in other units than kg and m",
    "joint_convention": "joints of the log have another order, direction or zero than those of the setup",
    "angle_units": "joint angles or the sensor's rotation are in degrees",
    "force_torque_swapped": "force and torque are swapped",
    "sensor_axes": "the sensor's axes are turned",
    "quaternion_convention": "the quaternion has another order, or is the inverse",
    "position_frame": "the recorded position has the axes of the body",
    "gyroscope_units": "the gyroscope or the accelerometer is in other units",
    "compensated": "the controller has subtracted the payload already",
    "rezeroed": "the sensor was set to zero with the tool on",
    "time_offset": "the wrench and the motion have clocks that differ",
    "base_frame_wrench": "the wrench has the axes of the base frame",
    "raw_offset": "the reading's offset is far beyond what the setup expects of the bias",
    "worse_than_raw": "the model makes the reading worse than doing nothing",
}
"""Name of every detectable mistake -> its description."""
MUCH_IS_LEFT = (
    "but more is left than the usual effects leave: another tool, or a mistake that is none of these; ftbias calibrate "
    "tries tool, mounting and gravity, and ftbias diagnose tells what the rest follows"
)
MAX_LISTED = 4
"""Maximum number of indistinguishable mistakes listed with a mistake."""


class Undetermined(NamedTuple):
    """A kind of mistake that a log cannot reveal."""

    mistake: str
    """One of MISTAKES."""
    remedy: str
    """Which log, or which entry in the setup, would reveal it."""


@dataclass(frozen=True, eq=False)
class Mistake:
    """One mistake in a setup or a log."""

    mistake: str
    """One of MISTAKES."""
    evidence: Mapping[str, Any]
    """Supporting numbers: rms residuals of force (N) and torque (Nm) with a free bias, and others."""
    remedy: str
    """What to write into the setup, or to do to the log."""
    setup: Mapping[str, Any] = field(default_factory=dict)
    """Dotted setup keys with the values that correct it, where a setup can."""
    harmless: bool = False
    """Whether results are right in spite of it, though less certain than they could be."""
    mended_by: tuple[str, ...] = ()
    """Commands that accept it, because they are run to correct it."""
    alike: tuple[Mistake, ...] = ()
    """Mistakes that explain the logs equally well, because the motion does not distinguish them from this one."""

    @property
    def told(self) -> str:
        """The remedy, followed by the mistakes that explain the logs equally well."""
        if not self.alike:
            return self.remedy
        others = [str(other) for other in self.alike[:MAX_LISTED]]
        left = len(self.alike) - len(others)
        more = [f"{left} more in the JSON"] if left else []
        return "; or, indistinguishable in this motion: ".join([self.remedy, "; ".join(others + more)])

    def __str__(self) -> str:
        return f"{self.mistake}: {self.told}"


@dataclass(frozen=True, eq=False)
class Check:
    """Result of checking a setup against logs."""

    findings: tuple[Mistake, ...]
    evidence: Mapping[str, Any] = field(default_factory=dict)
    """Rms of the raw reading and of the residual of the setup as stated; empty if the logs are too short."""
    setup_path: str = ""
    """Where the setup was read from."""
    undetermined: tuple[Undetermined, ...] = ()
    """Mistakes that these logs could not have revealed, each with what would reveal it."""

    @property
    def ok(self) -> bool:
        """Whether no mistake was found."""
        return not self.findings

    @property
    def worse_than_raw(self) -> bool:
        """Whether the model makes the reading worse than doing nothing."""
        return bool(self.evidence.get("worse_than_raw", False))

    def lines(self) -> list[str]:
        """Summary for a user: one line per mistake."""
        worse = "with this setup the corrected wrench is worse than the raw one: "
        first = [worse if self.worse_than_raw else "the setup seems wrong: "]
        return [(first.pop() if first else "also ") + str(finding) for finding in self.findings]

    def require_ok(self, command: str = "", looked_for: Collection[str] = ()) -> None:
        """Raise an error if the setup is wrong, except for mistakes that a command corrects or that are ``looked_for``.

        Raises:
            SetupError: the setup is wrong; the error states what to write into it.
            LogError: the log has other units or conventions than the setup can state.
        """
        bad = [
            f for f in self.findings if not f.harmless and command not in f.mended_by and f.mistake not in looked_for
        ]
        if not bad:
            return
        first = bad[0]
        kind: type[FtbiasError] = SetupError if first.setup else LogError
        worse = self.worse_than_raw and first.mistake != "worse_than_raw"
        message = MISTAKES[first.mistake] + f", and {MISTAKES['worse_than_raw']}" * worse
        remedy = "; ".join(finding.told for finding in bad)
        if any(finding.mistake == "sensor_axes" for finding in bad):
            remedy += "; ftbias identify --mounting finds any rotation of the sensor"
        raise kind(message, file=self.setup_path, field=first.mistake, remedy=f"{remedy}; --unchecked goes on anyway")

    def as_dict(self) -> dict[str, Any]:
        """Content of the file that ``to_json`` writes."""
        findings = [
            {**_as_dict(f), "evidence": dict(f.evidence), "alike": list(map(_as_dict, f.alike))} for f in self.findings
        ]
        unseen = [{"mistake": name, "remedy": remedy} for name, remedy in self.undetermined]
        return {"ok": self.ok, "findings": findings, "evidence": dict(self.evidence), "undetermined": unseen}

    def to_json(self, path: str | os.PathLike[str], origin: Provenance | None = None) -> None:
        """Write the findings and their provenance as JSON, atomically.

        Raises:
            OutputError: the file cannot be written.
        """
        said = {} if origin is None else {"provenance": origin}
        write_json(path, self.as_dict() | said)

    def __str__(self) -> str:
        return "\n".join((*self._found(), *self.open_questions()))

    def _found(self) -> list[str]:
        if self.findings:
            return [f"{finding}{_shown(finding.evidence)}" for finding in self.findings]
        if not self.evidence:
            return ["no mistake found; the logs are too short to show much"]
        return [f"no mistake found{_shown(self.evidence)}", *[MUCH_IS_LEFT] * bool(self.evidence.get("much_is_left"))]

    def open_questions(self) -> list[str]:
        """Mistakes that could not be checked, one line per remedy."""
        remedies: dict[str, list[str]] = {}
        for name, remedy in self.undetermined:
            remedies.setdefault(remedy, []).append(name)
        return [f"not shown by these logs: {', '.join(names)}: {remedy}" for remedy, names in remedies.items()]


def _as_dict(mistake: Mistake) -> dict[str, Any]:
    return {"mistake": mistake.mistake, "remedy": mistake.remedy, "setup": dict(mistake.setup)}


def _shown(evidence: Mapping[str, Any]) -> str:
    """Format the numbers in brackets, to follow a sentence."""
    words = [f"{name.replace('_', ' ')} {value}" for name, value in evidence.items() if not isinstance(value, bool)]
    return f" ({', '.join(words)})" if words else ""
