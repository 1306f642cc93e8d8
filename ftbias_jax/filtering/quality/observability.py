"""What a log cannot tell from the bias: errors of the tool.

The weight reads m g and m c x g. What of that is constant looks like a bias, so an error of the stated mass m or centre
of mass c shows only as far as g turns, as seen from the sensor: mass by any turning, c along a direction n by that part
of it which is perpendicular to n.

A tool that is stated wrongly by d theta shifts the reading by D d theta, and the bias takes that up: it is no noise,
and does not average out. Nobody knows how much of it the bias has taken up at a sample, so all of it counts in the
error bars.
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
"""Poses that are looked at in each part of a log."""
NAMES = ("bias_std", "contact_wrench_std", "bias_smooth_std")
"""Arrays of a result that contain the errors of tool and effects."""
EXACT = np.zeros(3)
"""m/s^2: what is not known of accelerations where no accelerometer is used."""


def start() -> Array:
    """Before the first part: (0, 3) unit vectors along gravity, sensor frame."""
    return np.empty((0, 3))


def add(down: Array, params: Params, part: Filtered) -> Array:
    """Take in poses of the next part."""
    if not len(part.t) or not (np.any(params.gravity) and np.any(params.theta)):  # no weight is in the reading
        return down
    rows = np.linspace(0, len(part.t) - 1, POSES).astype(int)
    joints = np.stack([part.q[rows], part.dq[rows], part.ddq[rows]], 2)
    return np.concatenate([down, np.asarray(_down(params, joints), np.float64)])


def unobservable(down: Array) -> list[str]:
    """What of the tool is indistinguishable from the bias, in words; [] if the sensor turns about two axes."""
    spread = np.cov(down.T, bias=True)
    if np.trace(spread) < LEAST_TURN**2:
        return ["mass", "center_of_mass"]
    variance, directions = np.linalg.eigh(spread)
    if variance[0] + variance[1] < LEAST_TURN**2:
        along = directions[:, 2] * np.sign(directions[np.abs(directions[:, 2]).argmax(), 2])
        return [f"center_of_mass along ({', '.join(f'{x:.2f}' for x in np.round(along, 2) + 0.0)})"]
    return []


def remarks(down: Array) -> Repairs:
    """What the owner of a log should know of its motion; () if it shows enough."""
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
    """(T, 6) N, Nm, standard deviation of the tool's wrench (T, 6) by the standard errors that the setup states.

    An error of the mass scales the wrench, with centre and inertia for each kg as stated; an error c of the centre adds
    c x f to the torque. An accelerometer's error ``acceleration_std`` (3,) m/s^2 acts on the mass at its centre.
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


def with_error_of_model(filtered: Filtered, setup: Setup, acceleration_std: Array = EXACT) -> Filtered:
    """A result whose error bars contain those of tool, effects and accelerometer, which the filter takes as known."""
    tool, of_effects = setup.tool, setup.bias.model_std
    known = tool.mass_std is None and tool.center_of_mass_std is None and of_effects is None
    if known and not np.any(acceleration_std):
        return filtered
    error = error_of_tool(filtered.wrench_tool, tool, acceleration_std)
    error = error if of_effects is None else np.hypot(error, of_effects)
    shown: dict[str, Any] = {name: x for name in NAMES if (x := getattr(filtered, name)) is not None}
    return replace(filtered, **{name: np.hypot(std, error) for name, std in shown.items()})


def remark_of_model(setup: Setup) -> Repairs:
    """What the owner should know about error bars that contain those of tool and effects; () if the setup has none."""
    tool, of_effects = setup.tool, setup.bias.model_std
    stated = [f"{tool.mass_std:.2g} kg"] if tool.mass_std is not None else []
    if tool.center_of_mass_std is not None:
        stated.append(f"{' '.join(f'{1e3 * x:.2g}' for x in tool.center_of_mass_std)} mm")
    remarks = [f"of the tool: standard errors of {' and '.join(stated)}"] if stated else []
    if of_effects is not None and of_effects.any():
        words = " ".join(f"{x:.2g}" for x in of_effects)
        remarks.append(f"of the effects: standard errors of {words} N, Nm in the reading")
    return tuple(Repair(f"the error bars contain what is not known {remark}") for remark in remarks)
