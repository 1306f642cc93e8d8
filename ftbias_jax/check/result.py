"""What a check finds, in words and for programs."""

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
    "force_torque_swapped": "the torque stands where the force should be",
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
"""Every mistake that is recognised, and what it is."""
MOST_TOLD = 4
"""Mistakes told beside one that a log does not tell from it."""


class Undetermined(NamedTuple):
    """A kind of mistake that a log cannot show."""

    mistake: str
    """One of MISTAKES."""
    remedy: str
    """What log, or what in the setup, would show it."""


@dataclass(frozen=True, eq=False)
class Mistake:
    """One mistake in a setup or a log."""

    mistake: str
    """One of MISTAKES."""
    evidence: Mapping[str, Any]
    """Numbers that show it: rms of what is left of force (N) and torque (Nm), with the bias free, and more."""
    remedy: str
    """What to write into the setup, or to do to the log."""
    setup: Mapping[str, Any] = field(default_factory=dict)
    """Dotted keys with the values that mend it, where a setup can."""
    harmless: bool = False
    """Whether results are right all the same, if less sure than they could be."""
    mended_by: tuple[str, ...] = ()
    """Commands that can do with it, because they are there to mend it."""
    alike: tuple[Mistake, ...] = ()
    """What would explain the logs as well: their motion does not tell it from this mistake."""

    @property
    def told(self) -> str:
        """The remedy, and the others that would do as well."""
        if not self.alike:
            return self.remedy
        others = [str(other) for other in self.alike[:MOST_TOLD]]
        left = len(self.alike) - len(others)
        more = [f"{left} more in the JSON"] if left else []
        return "; or, which this motion cannot tell apart: ".join([self.remedy, "; ".join(others + more)])

    def __str__(self) -> str:
        return f"{self.mistake}: {self.told}"


@dataclass(frozen=True, eq=False)
class Check:
    """Whether a setup can be right, as far as logs show it."""

    findings: tuple[Mistake, ...]
    evidence: Mapping[str, Any] = field(default_factory=dict)
    """The same numbers of the setup as stated; empty if the logs are too short to tell."""
    setup_path: str = ""
    """Where the setup was read from."""
    undetermined: tuple[Undetermined, ...] = ()
    """Mistakes that these logs could not have shown, each with what would show it."""

    @property
    def ok(self) -> bool:
        """Whether no mistake was found."""
        return not self.findings

    @property
    def worse_than_raw(self) -> bool:
        """Whether the model makes the reading worse than doing nothing."""
        return bool(self.evidence.get("worse_than_raw", False))

    def lines(self) -> list[str]:
        """What to tell a user first: a line for every mistake."""
        worse = "with this setup the corrected wrench is worse than the raw one: "
        first = [worse if self.worse_than_raw else "the setup seems wrong: "]
        return [(first.pop() if first else "also ") + str(finding) for finding in self.findings]

    def require_ok(self, command: str = "", looked_for: Collection[str] = ()) -> None:
        """Refuse a setup that is wrong, but for mistakes that a command is there to mend, or that are ``looked_for``.

        Raises:
            SetupError: the setup is wrong, and says what to write into it.
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
        raise kind(message, file=self.setup_path, field=first.mistake, remedy=f"{remedy}; --unchecked goes on anyway")

    def as_dict(self) -> dict[str, Any]:
        """What ``to_json`` writes."""
        findings = [
            {**_as_dict(f), "evidence": dict(f.evidence), "alike": list(map(_as_dict, f.alike))} for f in self.findings
        ]
        unseen = [{"mistake": name, "remedy": remedy} for name, remedy in self.undetermined]
        return {"ok": self.ok, "findings": findings, "evidence": dict(self.evidence), "undetermined": unseen}

    def to_json(self, path: str | os.PathLike[str], origin: Provenance | None = None) -> None:
        """Write the findings, and what they were made from, for programs, whole or not at all.

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
        return [f"no mistake found{_shown(self.evidence)}"]

    def open_questions(self) -> list[str]:
        """What could not be looked for, a line for each remedy."""
        remedies: dict[str, list[str]] = {}
        for name, remedy in self.undetermined:
            remedies.setdefault(remedy, []).append(name)
        return [f"not shown by these logs: {', '.join(names)}: {remedy}" for remedy, names in remedies.items()]


def _as_dict(mistake: Mistake) -> dict[str, Any]:
    return {"mistake": mistake.mistake, "remedy": mistake.remedy, "setup": dict(mistake.setup)}


def _shown(evidence: Mapping[str, Any]) -> str:
    """The numbers, behind the sentence."""
    words = [f"{name.replace('_', ' ')} {value}" for name, value in evidence.items() if not isinstance(value, bool)]
    return f" ({', '.join(words)})" if words else ""
