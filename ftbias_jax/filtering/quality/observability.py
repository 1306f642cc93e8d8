"""Errors of the tool that are indistinguishable from the bias.

The weight causes the readings m g and m c x g. Their constant part looks like a bias, so an error of the stated mass m
or centre of mass c is observable only as far as g turns in the sensor frame: mass by any turn, c along a direction n by
the part of the turn of g that is perpendicular to n.

A tool stated wrongly by d theta shifts the reading by D d theta, and the bias absorbs that: it is not noise, and does
not average out. How much of it the bias has absorbed at a sample is unknown, so all of it counts in the error bars.
"""

from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np

from ftbias_jax.filtering.quality.at_rest import LEAST_TURN
from ftbias_jax.filtering.result import Filtered
from ftbias_jax.io.log import Repair, Repairs
from ftbias_jax.model.kinematics.recorded_pose import motions_of
from ftbias_jax.model.params import Params
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.setup.types import Setup, ToolSetup
from ftbias_jax.types import Array

POSES = 64
"""Number of poses that are examined in each part of a log."""
NAMES = ("bias_std", "contact_wrench_std", "bias_smooth_std")
"""Arrays of a result that include the errors of tool and effects."""
EXACT = np.zeros(3)
"""m/s^2: standard deviation of accelerations where no accelerometer is used."""


def start() -> Array:
    """Empty tally before the first part: (0, 3) unit vectors along gravity, sensor frame."""
    return np.empty((0, 3))


def add(down: Array, params: Params, part: Filtered) -> Array:
    """Add poses of the next part."""
    if not len(part.t) or not (np.any(params.gravity) and np.any(params.theta)):  # no weight is in the reading
        return down
    rows = np.linspace(0, len(part.t) - 1, POSES).astype(int)
    joints = np.stack([part.q[rows], part.dq[rows], part.ddq[rows]], 2)
    return np.concatenate([down, np.asarray(_down(params, joints), np.float64)])


def unobservable(down: Array) -> list[str]:
    """Tool parameters that are indistinguishable from the bias, in words; [] if the sensor turns about two axes."""
    spread = np.cov(down.T, bias=True)
    if np.trace(spread) < LEAST_TURN**2:
        return ["mass", "center_of_mass"]
    variance, directions = np.linalg.eigh(spread)
    if variance[0] + variance[1] < LEAST_TURN**2:
        along = directions[:, 2] * np.sign(directions[np.abs(directions[:, 2]).argmax(), 2])
        return [f"center_of_mass along ({', '.join(f'{x:.2f}' for x in np.round(along, 2) + 0.0)})"]
    return []


def remarks(down: Array) -> Repairs:
    """Remark for the owner of a log that turns the sensor too little; () if it turns enough."""
    if len(down) and (hidden := unobservable(down)):
        what = f"the sensor turns too little: errors of the tool's {' and '.join(hidden)} would look like bias"
        return (Repair(what),)
    return ()


@keep_program()
def _down(params: Params, joints: Array) -> Array:
    """(N, 3) unit vectors along gravity, sensor frame, for joint states (N, n, 3)."""
    turned = motions_of(params.arm, *jnp.moveaxis(joints, (2, 1), (0, 1))).sensor_rotation
    return jnp.einsum("ijn,i->nj", turned, params.gravity / jnp.linalg.norm(params.gravity))


def error_of_tool(wrench_tool: Array, tool: ToolSetup, acceleration_std: Array = EXACT) -> Array:
    """Standard deviation (T, 6) N, Nm of the tool's wrench (T, 6) from the standard errors that the setup states.

    An error of the mass scales the wrench, with centre of mass and inertia per kg as stated; an error c of the centre
    adds c x f to the torque. An accelerometer's error ``acceleration_std`` (3,) m/s^2 acts on the mass at its centre.
    """
    variance = np.zeros(np.shape(wrench_tool))
    fx, fy, fz = np.square(tool.mass * np.asarray(acceleration_std))
    x, y, z = np.square(tool.center_of_mass)
    variance += np.array([fx, fy, fz, y * fz + z * fy, z * fx + x * fz, x * fy + y * fx])
    if tool.mass_std is not None:
        variance += (wrench_tool * (tool.mass_std / tool.mass)) ** 2
    if tool.center_of_mass_std is not None:
        x, y, z = np.square(tool.center_of_mass_std)
        fx, fy, fz = np.square(wrench_tool[:, :3]).T
        variance[:, 3:] += np.stack([y * fz + z * fy, z * fx + x * fz, x * fy + y * fx], 1)
    return np.sqrt(variance)


def with_error_of_model(
    filtered: Filtered, setup: Setup, acceleration_std: Array = EXACT, tool_error: float = 0.0
) -> Filtered:
    """A result whose error bars include those of tool, effects and accelerometer, which the filter takes as known.

    ``tool_error`` is the relative error of the tool's force that the log shows.
    """
    tool, of_effects = setup.tool, setup.bias.model_std
    if tool_error:
        tool = replace(tool, mass_std=float(np.hypot(tool.mass_std or 0.0, tool_error * tool.mass)))
    known = tool.mass_std is None and tool.center_of_mass_std is None and of_effects is None
    if known and not np.any(acceleration_std):
        return filtered
    error = error_of_tool(filtered.wrench_tool, tool, acceleration_std)
    error = error if of_effects is None else np.hypot(error, of_effects)
    shown: dict[str, Any] = {name: x for name in NAMES if (x := getattr(filtered, name)) is not None}
    return replace(filtered, **{name: np.hypot(std, error) for name, std in shown.items()})


def remark_of_model(setup: Setup) -> Repairs:
    """Remarks for the owner on error bars that include those of tool and effects; () if the setup has none."""
    tool, of_effects = setup.tool, setup.bias.model_std
    stated = [f"{tool.mass_std:.2g} kg"] if tool.mass_std is not None else []
    if tool.center_of_mass_std is not None:
        stated.append(f"{' '.join(f'{1e3 * x:.2g}' for x in tool.center_of_mass_std)} mm")
    remarks = [f"of the tool: standard errors of {' and '.join(stated)}"] if stated else []
    if of_effects is not None and of_effects.any():
        words = " ".join(f"{x:.2g}" for x in of_effects)
        remarks.append(f"of the effects: standard errors of {words} N, Nm in the reading")
    return tuple(Repair(f"the error bars include the uncertainty {remark}") for remark in remarks)
