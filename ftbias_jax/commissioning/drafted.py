"""Drafts of setups that are checked with their own log, so that they state what the controller did to the reading."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ftbias_jax.check.check_setup import check_setup
from ftbias_jax.io.draft.draft import Draft, Request, draft
from ftbias_jax.io.log import Log
from ftbias_jax.io.tables.poses import Poses
from ftbias_jax.setup.dump import Known
from ftbias_jax.setup.require import has_no_tool, with_guessed_tool
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

LOOSE = (0.3, 0.03)
"""Share of the mass, and m: standard errors assumed for a tool that is stated without them."""
LOOSE_GUESS = (1.0, 0.1)
"""kg and m: the same for a tool that is not stated."""
RECORDED = ("compensated", "rezeroed")
"""Mistakes that are facts of how a log was recorded, and not errors of a draft."""


def checked_draft(request: Request) -> Draft:
    """Draft a setup, and draft it again with what a check of the first draft finds.

    Raises:
        UsageError, LogError, SetupError: as for ``draft``.
    """
    found = draft(request)
    if found.log is not None and (further := _recorded_so(found.setup, found.log)):
        found = draft(request._replace(further=further))
    return found


def _recorded_so(setup: Setup, log: Log | Poses) -> dict[str, Known]:
    """Keys with which a check of the draft states that the controller compensates, or that the sensor was tared."""
    findings = check_setup(setup, [log]).findings
    return {
        key: Known(value, found.remedy.partition(":")[0])
        for found in findings
        if found.mistake in RECORDED
        for key, value in (found.setup or {}).items()
    }


def with_loose_tool(setup: Setup) -> Setup:
    """The setup with a tool to start from, and with standard errors where it states none."""
    guessed = with_guessed_tool(setup)
    mass, center = (max(LOOSE[0] * guessed.tool.mass, 0.0), LOOSE[1]) if guessed is setup else LOOSE_GUESS
    tool = guessed.tool
    if has_no_tool(setup) or tool.mass == 0:
        return setup
    mass_std = mass if tool.mass_std is None else tool.mass_std
    center_std = np.full(3, center) if tool.center_of_mass_std is None else tool.center_of_mass_std
    return replace(guessed, tool=replace(tool, mass_std=mass_std, center_of_mass_std=center_std))


def loosened(found: Setup, stated: Setup) -> Setup:
    """The identified tool with the standard errors of the stated one, so that causes may still change it as much.

    The place of its sensor, or the point that it turns about, is not taken over yet: a delay also looks like a lever
    arm.
    """
    loose = stated.tool
    tool = replace(found.tool, mass_std=loose.mass_std, center_of_mass_std=loose.center_of_mass_std)
    sensor = replace(found.sensor, translation=stated.sensor.translation)
    return replace(found, tool=tool, sensor=sensor, pose=stated.pose, bias=stated.bias)


def larger(one: Mapping[str, Array], other: Mapping[str, Array]) -> dict[str, Array]:
    """The larger of two standard errors of each key; an unknown one counts as smaller."""
    return {key: np.fmax(one.get(key, 0.0), other.get(key, 0.0)) for key in {**one, **other}}


def as_uncertain(found: Setup, beside: Mapping[str, Array]) -> Setup:
    """A setup whose tool has standard errors no smaller than those fitted beside its causes, by keys of [tool]."""
    errors = larger({key: getattr(found.tool, f"{key}_std") for key in beside}, beside)
    plain: dict[str, Any] = {f"{key}_std": std if std.ndim else float(std) for key, std in errors.items()}
    numbers = {f"tool.{key}": " ".join(f"{x:.2g}" for x in np.ravel(std)) for key, std in errors.items()}
    own = {key: f"identified ± {words}" for key, words in numbers.items() if "±" in found.comments.get(key, "")}
    comments = {**found.comments, **own}
    return replace(found, tool=replace(found.tool, **plain), comments=comments)
