"""Quality metrics of a log and its model for the manifest: a few plain numbers in SI units, (6,) N and Nm by axis."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from ftbias_jax.calibration.identify_tool import IdentifyResult
    from ftbias_jax.calibration.tune_result import TuneResult
    from ftbias_jax.check.result import Check
    from ftbias_jax.diagnosis.result import Diagnosis
    from ftbias_jax.filtering.verbs.results import FilterResult
    from ftbias_jax.io.write.provenance import Provenance

DIGITS = 6
"""Number of significant digits, few so that lines are short."""


def of_filter(result: FilterResult) -> dict[str, Any]:
    """Metrics of a filtered log; there are no findings if the check was skipped."""
    summary = result.summary
    return _quality(
        result.provenance or {},
        nis=summary.mean_nis,
        one_second_error=summary.one_second_rms,
        residual_std=summary.residual_std,
        raw_std=summary.raw_std,
        bias=summary.bias,
        bias_std=summary.bias_std,
        drift=summary.drift,
        drift_std=summary.drift_std,
        gated_share=summary.gated / summary.samples,
        findings=[finding.mistake for finding in result.checked.findings],
    )


def of_check(check: Check, origin: Provenance) -> dict[str, Any]:
    """Findings of the check of a setup on a log."""
    return _quality(origin, findings=[finding.mistake for finding in check.findings])


def of_diagnosis(diagnosis: Diagnosis) -> dict[str, Any]:
    """Metrics and findings of the diagnosis of a log."""
    gap = diagnosis.gap
    return _quality(
        diagnosis.provenance or {},
        verdict=diagnosis.verdict,
        causes=[cause.effect for cause in diagnosis.causes],
        doubtful=[cause.effect for cause in diagnosis.causes if cause.doubt],
        terms=[term.text for term in diagnosis.terms],
        gap_sigmas=gap.before_sigmas,
        gap_sigmas_after=gap.after_sigmas,
        shrink=gap.shrink,
        shrink_stderr=gap.shrink_stderr,
        sentence=diagnosis.sentence,
    )


def of_identified(result: IdentifyResult, origin: Provenance) -> dict[str, Any]:
    """Metrics of a tool identified from a log; kg, m, sensor frame."""
    tool = result.tool
    return _quality(
        origin,
        mass=tool.values[0],
        mass_std=tool.stderr[0],
        center_of_mass=tool.values[1:4],
        center_of_mass_std=tool.stderr[1:4],
        bias=tool.bias,
        bias_std=tool.bias_stderr,
    )


def of_tuned(result: TuneResult, origin: Provenance) -> dict[str, Any]:
    """Metrics of noise tuned to a log: the noise, and the gain of scores on the held-out part, nats/s."""
    gained = {f"{score.part}_score_gained": score.after - score.before for score in result.held_out}
    noise = result.setup.bias.noise_density
    return _quality(origin, noise_density=noise, noise_std=result.setup.sensor.noise_std, **gained)


def _quality(origin: Mapping[str, Any], **found: Any) -> dict[str, Any]:
    """Metrics, with the start of the log by its own stamps, its duration, s, and its rate, Hz."""
    known = {name: origin.get(name) for name in ("date", "duration", "rate")}
    return {name: _plain(value) for name, value in (known | found).items()}


def _plain(value: Any) -> Any:
    """Value that JSON can hold: numbers of a few digits, None if not finite."""
    if value is None or isinstance(value, str | bool):
        return value
    if isinstance(value, Iterable):
        return [_plain(item) for item in (value.tolist() if isinstance(value, np.ndarray) else value)]
    return float(f"{float(value):.{DIGITS}g}") if math.isfinite(value) else None
