"""What ``identify_tool`` prints below its table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ftbias_jax.calibration.tool.steps import Step

if TYPE_CHECKING:
    from ftbias_jax.calibration.identify import Identified
    from ftbias_jax.calibration.identify_poses import PoseReport

MUCH = 5.0
"""Innovations this many times larger than the noise stated are no noise."""
WHY_IT_JUMPS = "a tare (state sensor.rezeroed_at), a touch, or a load that changed; the bias is free to jump there"


def motion_lines(found: Identified, steps: Sequence[Step]) -> list[str]:
    """What a log of motion said, and where its reading jumps."""
    lines = [f"likelihood gained: {found.gain:.1f} nats; condition number of the excitation: {found.condition:.0f}"]
    if found.excess > MUCH:
        lines.append(
            f"what remains is {found.excess:.0f} times the noise stated: look for contact, a wrong unit or a delay "
            "(ftbias diagnose)"
        )
    return lines + [f"the reading jumps on {step}: {WHY_IT_JUMPS}" for step in steps]


def pose_lines(report: PoseReport) -> list[str]:
    """How well static poses are predicted, and what least squares would have found."""
    drift = "constant bias"
    if report.drift.any():
        drift = f"bias drifting by {report.drift[0]:.2g} N, {report.drift[1]:.2g} Nm from pose to pose"
    mass, *center = report.plain
    where = " ".join(f"{1e3 * x:.2f}" for x in center)
    return [
        f"{report.poses} static poses, {drift}; each predicted from the others: {_errors(report.left_out)}",
        f"plain least squares: {mass:.4f} kg, centre of mass {where} mm, {_errors(report.plain_left_out)}",
    ]


def _errors(rms: np.ndarray) -> str:
    return f"rms {rms[0]:.3g} N, {rms[1]:.2g} Nm"


def plain_errors(values: np.ndarray) -> str:
    """Numbers for a comment in a setup; "-" = none."""
    return " ".join("-" if np.isnan(x) else f"{x:.2g}" for x in values)


def with_errors(values: np.ndarray, stderr: np.ndarray) -> str:
    """Numbers with their standard errors."""
    return ", ".join(f"{x:.4g} ± {e:.2g}" for x, e in zip(values, stderr, strict=True))
