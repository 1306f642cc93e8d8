"""Requirements on one setup or several that only some commands have."""

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np

from ftbias_jax.errors import SetupError
from ftbias_jax.setup.fields import show
from ftbias_jax.setup.types import COMPENSATED, Setup, ToolSetup

NOT_STATED = "not determined by this motion, not stated"
"""Remark on a parameter that is neither determined nor stated."""
SEEN = 0.3
"""Share of the noise of a sample above which a constant error shows in the mean of many."""
GUESS = (1.0, (0.0, 0.0, 0.05))
"""kg and m; tool from which a search starts, where the setup does not state one."""
_OWN = {
    "bias": ("initial", "initial_drift", "initial_std", "initial_drift_std"),
    "sensor": ("rotation_rpy", "rezeroed", "rezeroed_at"),
    "robot": ("position_limits", "velocity_limits"),
}
"""Fields that may differ between setups of one robot besides the tool: the prior of the bias, how the rotation was
written, and the same arm's limits."""


def require_tool(setup: Setup) -> Setup:
    """Return the setup if it states the tool's mass and centre of mass, or the reading has nothing of the tool in it.

    Raises:
        SetupError: one of the two is not stated; the error names the first.
    """
    for key in () if has_no_tool(setup) else setup.tool.unknown:
        command = f"ftbias identify LOG --setup {setup.path or 'SETUP.toml'} -o IDENTIFIED.toml"
        remedy = f"measure it, or find it in a log of free motion: {command}"
        raise SetupError("is not stated", file=setup.path, field=f"tool.{key}", remedy=remedy)
    return setup


def has_no_tool(setup: Setup) -> bool:
    """Return whether the controller has subtracted the tool's whole wrench, so that the tool need not be known."""
    return setup.sensor.compensated == COMPENSATED[2]


def is_draft(setup: Setup) -> bool:
    """Return whether the stated errors of the tool would show in the mean of many samples, as for a drafted tool."""
    tool, noise, weight = setup.tool, setup.sensor.noise_std, np.linalg.norm(setup.robot.gravity)
    force = weight * (tool.mass_std or 0.0)
    torque = 0.0 if tool.center_of_mass_std is None else tool.mass * weight * tool.center_of_mass_std.max()
    return bool(force > SEEN * noise[:3].min() or torque > SEEN * noise[3:].min())


def has_open_place(setup: Setup) -> bool:
    """Return whether the place of the sensor on the flange is not stated, in a setup whose tool is a draft, too."""
    stated = setup.sensor.translation.any() or "mount_translation" in setup.effects
    return not stated and (bool(setup.tool.unknown) or is_draft(setup))


def with_guessed_tool(setup: Setup) -> Setup:
    """Return the setup with a guess for a mass or centre of mass that is not stated; unchanged if both are."""
    tool = setup.tool
    if not tool.unknown:
        return setup
    mass = tool.mass if np.isfinite(tool.mass) else GUESS[0]
    center = tool.center_of_mass if np.isfinite(tool.center_of_mass).all() else np.array(GUESS[1])
    return replace(setup, tool=replace(tool, mass=mass, center_of_mass=center))


def guessed_parameters(given: ToolSetup, remarks: Sequence[str]) -> tuple[bool, ...]:
    """(10,) whether each parameter is still the initial guess, because it was neither stated nor found; () = none is.

    A centre of mass is written as a whole or not at all, and never without a mass. The (10,) remarks state why a
    parameter of the given tool was not found; "" = it was.
    """
    mass = "mass" in given.unknown and bool(remarks[0])
    center = "center_of_mass" in given.unknown and (mass or any(remarks[1:4]))
    return (mass, *(center,) * 3, *(False,) * 6) if mass or center else ()


def orientation_alone(setup: Setup) -> Setup:
    """Return the setup for poses at rest, which have only an orientation; unchanged if it has joints."""
    pose = setup.pose
    if pose is None:
        return setup
    still = replace(pose, linear="none", position_noise_std=pose.position_noise_std[:4])
    entries = still.columns[0]
    columns = {name: x[:entries] if name == "position" else x for name, x in setup.log.columns.items()}
    joints = replace(setup.joints, position_noise_std=setup.joints.position_noise_std[:4])
    robot = replace(setup.robot, screws=setup.robot.screws[:4], joint_names=setup.robot.joint_names[:4])
    return replace(setup, pose=still, robot=robot, joints=joints, log=replace(setup.log, columns=columns))


def require_one_robot(first: Setup, other: Setup) -> None:
    """Raise an error if a setup differs from the first one in more than the tool and the prior of the bias.

    Raises:
        SetupError: they differ; the error names the first difference.
    """
    for section in ("robot", "sensor", "bias", "joints", "data_noise", "effects", "pose"):
        one, two = getattr(first, section), getattr(other, section)
        name = "sensor_pose" if section == "pose" else section
        if one is None or two is None or isinstance(one, dict):
            _compare(first, other, name, one, two)
            continue
        for field in fields(one):
            if field.name not in _OWN.get(section, ()):
                _compare(first, other, f"{name}.{field.name}", getattr(one, field.name), getattr(two, field.name))


def _compare(first: Setup, other: Setup, field: str, one: object, two: object) -> None:
    if np.array_equal(one, two):  # type: ignore[arg-type]  # also strings and tables
        return
    message = f"{_shown(two)} differs from {_shown(one)} in {first.path or 'the first setup'}"
    remedy = "setups of several tools share robot, sensor and noise; [tool] and the bias's initial values may differ"
    raise SetupError(message, file=other.path, field=field, remedy=remedy)


def _shown(value: object) -> str:
    return show(value.tolist() if isinstance(value, np.ndarray) else value)
