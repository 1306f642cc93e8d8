"""A tool to check with, where the setup does not state one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ftbias_jax.filtering.check.judge import LEVER
from ftbias_jax.filtering.check.regression import free_tool
from ftbias_jax.filtering.check.state import Case, stated
from ftbias_jax.setup.require import with_guessed_tool
from ftbias_jax.setup.types import ToolSetup

LIGHTEST = 1e-3
"""kg."""


def with_found_tool(case: Case) -> Case:
    """The case with the tool that the reading itself shows, if its setup leaves mass or centre of mass open.

    A sign, an axis or a frame that is wrong shows all the same: no tool weighs less than nothing.
    """
    setup = case.setup
    if not setup.tool.unknown:
        return case
    guessed = with_guessed_tool(setup)
    state = stated(replace(case, setup=guessed))
    theta = state.fit(free_tool(state.tool)).fit.theta
    mass = max(abs(float(theta[0])), LIGHTEST)
    center = theta[1:4] / np.copysign(mass, theta[0])
    center = center * min(1.0, LEVER / 2 / max(float(np.linalg.norm(center)), 1e-12))
    return replace(case, setup=replace(setup, tool=ToolSetup(mass, center, guessed.tool.inertia)))
