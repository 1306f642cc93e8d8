"""Error bars of a bias that contain what is not known of the tool.

A tool that is stated wrongly by d theta shifts the reading by D d theta, and the bias takes that up: it is no noise,
and does not average out. Nobody knows how much of it the bias has taken up at a sample, so all of it counts.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ftbias_jax.filtering.result import Filtered
from ftbias_jax.io.log import Repair, Repairs
from ftbias_jax.setup.types import ToolSetup
from ftbias_jax.types import Array

NAMES = ("bias_std", "contact_wrench_std", "bias_smooth_std")
"""Arrays that contain it."""


def error_of_tool(wrench_tool: Array, tool: ToolSetup) -> Array:
    """(T, 6) N, Nm, standard deviation of the tool's wrench (T, 6) by the standard errors that the setup states.

    An error of the mass scales the wrench, with centre and inertia for each kg as stated; an error c of the centre adds
    c x f to the torque.
    """
    variance = np.zeros(np.shape(wrench_tool))
    if tool.mass_std is not None:
        variance += (wrench_tool * (tool.mass_std / tool.mass)) ** 2
    if tool.center_of_mass_std is not None:
        x, y, z = np.square(tool.center_of_mass_std)
        fx, fy, fz = np.square(wrench_tool[:, :3]).T
        variance[:, 3:] += np.stack([y * fz + z * fy, z * fx + x * fz, x * fy + y * fx], 1)
    return np.sqrt(variance)


def with_error_of_tool(filtered: Filtered, tool: ToolSetup) -> Filtered:
    """A result whose error bars contain the standard errors of the tool, which the filter takes as known."""
    if tool.mass_std is None and tool.center_of_mass_std is None:
        return filtered
    error = error_of_tool(filtered.wrench_tool, tool)
    known: dict[str, Any] = {name: x for name in NAMES if (x := getattr(filtered, name)) is not None}
    return replace(filtered, **{name: np.hypot(std, error) for name, std in known.items()})


def remark_of_tool(tool: ToolSetup) -> Repairs:
    """What the owner should know about error bars that contain the tool's; () where the setup states none."""
    stated = [f"{tool.mass_std:.2g} kg"] if tool.mass_std is not None else []
    if tool.center_of_mass_std is not None:
        stated.append(f"{' '.join(f'{1e3 * x:.2g}' for x in tool.center_of_mass_std)} mm")
    if not stated:
        return ()
    what = f"the error bars contain what is not known of the tool: standard errors of {' and '.join(stated)}"
    return (Repair(what),)
