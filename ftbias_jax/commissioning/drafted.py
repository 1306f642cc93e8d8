"""A draft of a setup that a check of its own log has seen: what the controller did to the reading is stated in it."""

from __future__ import annotations

from ftbias_jax.check.check_setup import check_setup
from ftbias_jax.io.draft.draft import Draft, Request, draft
from ftbias_jax.io.log import Log
from ftbias_jax.setup.keys.template import Known
from ftbias_jax.setup.types import Setup

RECORDED = ("compensated", "rezeroed")
"""Mistakes that are facts of how a log was recorded, and no error of a draft."""


def checked_draft(request: Request) -> Draft:
    """Draft a setup, and once more with what a check of the first draft finds.

    Raises:
        UsageError, LogError, SetupError: as of ``draft``.
    """
    found = draft(request)
    if found.log is not None and (further := _recorded_so(found.setup, found.log)):
        found = draft(request._replace(further=further))
    return found


def _recorded_so(setup: Setup, log: Log) -> dict[str, Known]:
    """Keys by which a check of the draft says that the controller compensates, or that the sensor was set to zero."""
    findings = check_setup(setup, [log]).findings
    return {
        key: Known(value, found.remedy.partition(":")[0])
        for found in findings
        if found.mistake in RECORDED
        for key, value in (found.setup or {}).items()
    }
