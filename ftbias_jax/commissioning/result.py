"""Result of a calibration: the setup, which steps were tried, why they were kept or not, errors before and after."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ftbias_jax.calibration.identify_tool import IdentifyResult
from ftbias_jax.calibration.judgement import HORIZONS
from ftbias_jax.calibration.tool.physical import NAMES
from ftbias_jax.commissioning.judged import CONSTANT, HEAD, HELD_TARE, Judged, table
from ftbias_jax.diagnosis.report.page import html_table, section, typeset, whole_page
from ftbias_jax.diagnosis.report.svg import escape
from ftbias_jax.diagnosis.result import Diagnosis
from ftbias_jax.filtering.noise.log_noise import force_of_tool
from ftbias_jax.io.atomic import plain
from ftbias_jax.io.log import Repair, Repairs
from ftbias_jax.model.effects.statements import value_words
from ftbias_jax.setup.dump import dump_setup
from ftbias_jax.setup.save import write_text
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import AXES

CAUSES, TERMS, TOOL, CHANNELS, NOISE = "causes", "terms", "tool", "gains and crosstalk", "noise"
FIRST, MOUNTING = "tool, first", "mounting"
"""Kinds of steps."""
GIVEN, CALIBRATED = "setup as given", "calibrated"
"""Rows of the errors that come from a filter."""
HOW_TO_READ = (
    "Root mean square errors of predicting the reading at the end of the logs, which no step has seen, from what the "
    "filter knew so many seconds before; beside it what needs no filter, with the calibrated tool."
)
AS_GOOD = 1.02
"""A held bias predicts better if the errors of the setup are more than this many times larger."""


@dataclass(frozen=True)
class Step:
    """A step that was tried."""

    kind: str
    """"mounting", "causes", "terms", "tool", "gains and crosstalk", "noise" or "tool, first"."""
    name: str
    kept: bool
    why: str
    """How the errors on held-out data change, or why the step could not be tried."""
    parts: tuple[str, ...] = ()
    """Names of the effects, drives of the terms, "tool", "crosstalk", "noise" or
    "mounting"; () = nothing was found to try."""


@dataclass(frozen=True, eq=False)
class Calibrated:
    """A calibrated setup, and how well it predicts."""

    setup: Setup
    """Setup with what was kept, except ``events``."""
    steps: tuple[Step, ...]
    rows: dict[str, Judged]
    """Errors on the held-out end of the logs: of the setup as given, of the calibrated one if anything was kept, and of
    biases that are held."""
    diagnosis: Diagnosis | None
    """The last diagnosis; None = there was none."""
    repairs: tuple[Repairs, ...] = ()
    """One per log: what was repaired or left out."""
    seconds: float = 0.0
    """s that the calibration took."""
    events: tuple[str, ...] = ()
    """What was kept but belongs to these logs alone: the errors include it, the setup for other logs does not."""

    @property
    def kept(self) -> tuple[Step, ...]:
        """The steps that were kept."""
        return tuple(step for step in self.steps if step.kept)

    @property
    def constant_is_better(self) -> tuple[str, ...]:
        """Axes and horizons on which a bias that is held predicts better than the setup."""
        held = [judged.rms for name, judged in self.rows.items() if name not in (GIVEN, CALIBRATED)]
        worse = self.rows.get(CALIBRATED, self.rows[GIVEN]).rms > AS_GOOD * np.min(held, axis=0)
        return tuple(f"{AXES[j]} {HORIZONS[i]:g} s ahead" for i, j in zip(*np.nonzero(worse), strict=True))

    @property
    def left_out(self) -> str:
        """What the setup leaves out, in words; "" = nothing."""
        if not self.events:
            return ""
        text = f"events of these logs alone, left out of the setup: {', '.join(self.events)}"
        carried = "; a part was carried: weigh it and the tool by ftbias identify --payloads"
        return text + carried if "term of acceleration" in self.events else text

    @property
    def sentence(self) -> str:
        """The outcome in one sentence."""
        if not self.kept:
            return "Nothing that was tried predicts the unseen end better: the setup is as given."
        return f"Kept {len(self.kept)} of {len(self.steps)} steps: {'; '.join(step.name for step in self.kept)}."

    def save(self, path: str | os.PathLike[str], by: str = "") -> None:
        """Write the setup; raises what ``Setup.save`` raises.

        Args:
            path: path of the TOML file.
            by: as for ``Setup.save``.
        """
        self.setup.save(path, by)

    def to_html(self, path: str | os.PathLike[str]) -> None:
        """Write a page with steps, errors and the setup.

        Args:
            path: path of the page.

        Raises:
            OutputError: the file cannot be written there.
        """
        steps = [("kept" if step.kept else "not kept", step.name, step.why) for step in self.steps]
        body = (
            f"<header><p class='small'>Calibration</p><h1>{typeset(self.sentence)}</h1></header>"
            + section("How well the reading is predicted", f"<p>{HOW_TO_READ}</p>{html_table(HEAD, table(self.rows))}")
            + section("What was tried", html_table(("", "step", "errors on the unseen end"), steps))
            + section("What is left", f"<p>{typeset(self.diagnosis.sentence)}</p>" if self.diagnosis else "")
            + section("The setup", f"<p>{self.left_out}</p><pre>{escape(dump_setup(self.setup))}</pre>")
        )
        write_text(path, whole_page("Calibration", body))

    def plain(self) -> dict[str, Any]:
        """Kept and refused steps, and errors on the held-out end, as plain lists and numbers for JSON."""
        ours = self.rows.get(CALIBRATED, self.rows[GIVEN])

        def of_horizon(i: int) -> dict[str, Any]:
            rows = {"ours": ours.rms, "given": self.rows[GIVEN].rms, "coverage": ours.coverage}
            held = {"held_tare": HELD_TARE, "constant": CONSTANT}
            rows |= {key: self.rows[name].rms for key, name in held.items() if name in self.rows}
            return {key: plain(row[i]) for key, row in rows.items()}

        return {
            "kept": list(dict.fromkeys(part for step in self.kept for part in step.parts)),
            "refused": [{"what": step.name, "why": step.why} for step in self.steps if not step.kept],
            "of_these_logs": list(self.events),
            "forecast": {f"{seconds:g}": of_horizon(i) for i, seconds in enumerate(HORIZONS)},
            "axes": list(AXES),
            "used": float(np.nanmean(ours.used)),
            "verdict": self.diagnosis.verdict if self.diagnosis else None,
            "seconds": float(f"{self.seconds:.3g}"),
        }

    def __str__(self) -> str:
        lines = [self.sentence]
        lines += [f"  {'kept' if step.kept else 'not kept':9s} {step.name} ({step.why})" for step in self.steps]
        lines += aligned([HEAD, *table(self.rows)])
        if better := self.constant_is_better:
            lines.append(f"a bias that is held predicts better: {', '.join(better)}")
        lines += [self.left_out] if self.left_out else []
        return "\n".join(lines)


def poses_to_html(found: IdentifyResult, path: str | os.PathLike[str]) -> None:
    """Write a page with the tool identified from static poses, how well they predict each other, and the setup.

    Raises:
        OutputError: the file cannot be written there.
    """
    mass = value_words(found.tool.values[0], found.tool.stderr[0])
    sentence = "The poses do not show the tool's mass." if found.tool.remarks[0] else f"The tool weighs {mass} kg."
    body = (
        f"<header><p class='small'>Calibration by static poses</p><h1>{sentence}</h1></header>"
        + section("What the poses show", f"<pre>{escape(str(found))}</pre>")
        + section("The setup", f"<pre>{escape(dump_setup(found.setup))}</pre>")
    )
    write_text(path, whole_page("Calibration", body))


def plain_of_poses(found: IdentifyResult) -> dict[str, Any]:
    """The tool identified from static poses, and how well each pose is predicted from the others, for JSON."""
    numbers = zip(NAMES, found.tool.values, found.tool.stderr, found.tool.remarks, strict=True)
    shown = {name: {"value": plain(value), "stderr": plain(stderr)} for name, value, stderr, why in numbers if not why}
    assert found.poses is not None
    return {"kept": ["tool"], "refused": [], "forecast": {}, "tool": shown, "poses": plain(found.poses._asdict())}


def other_tool(error: float, logs: int) -> Repairs:
    """Remark on one of several ``logs`` whose tool, after the calibration, is not the one of all; () = it is."""
    if not error or logs < 2:
        return ()
    what = force_of_tool(error, "the calibrated")
    return (Repair(f"{what}: if the logs have different tools, calibrate each of them alone", lost=True),)


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a plain table: the first column to the left, numbers to the right."""
    first, *rest = (max(map(len, column)) for column in zip(*rows, strict=True))
    return [
        "  ".join((name.ljust(first), *(cell.rjust(w) for cell, w in zip(cells, rest, strict=True)))).rstrip()
        for name, *cells in rows
    ]


def nothing_found(found: IdentifyResult, crosstalk: bool) -> str:
    """Why an identification found nothing to try; "" = it did."""
    if not found.converged:
        return "the search did not converge"
    if crosstalk and (found.channels is None or not found.channels.shown):
        return "this log does not show any"
    return "this motion determines nothing of the tool" if all(found.tool.remarks) else ""
