"""The verb ``identify_tool``: a setup with the tool, and if asked the mounting and gravity, that a log shows."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace

import numpy as np

from ftbias_jax.calibration.identify import NAMES, UNITS, Identified, identify
from ftbias_jax.filtering import filter_log
from ftbias_jax.filtering.check.check_setup import require_right
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.filtering.samples import samples_from_log
from ftbias_jax.io.log import Log
from ftbias_jax.model.kinematics.screws import rotation_from_vector
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.setup.types import Setup


@dataclass(frozen=True, eq=False)
class IdentifyResult:
    """A setup with the tool that a log shows, and how well it shows it."""

    setup: Setup
    """With what was identified; ``save`` writes standard errors beside it."""
    tool: Identified
    """Values and standard errors, and what the motion leaves open."""
    mounting: bool
    """Whether the sensor's rotation on the flange was identified, too."""
    gravity: bool
    """Whether the direction of gravity was identified, too."""

    @property
    def converged(self) -> bool:
        """Whether the search found its optimum; if not, the values are the best so far."""
        return self.tool.converged

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the setup that was found; ``Setup.save`` has the errors.

        Args:
            path: of the TOML file.
        """
        self.setup.save(path)

    def __str__(self) -> str:
        found = self.tool
        lines = [f"{'':8s}{'value':>14s}{'± 1 sigma':>14s}"]
        for name, unit, value, stderr in zip(NAMES, UNITS, found.values, found.stderr, strict=True):
            lines.append(f"{name:8s}{value:14.6g}{stderr:14.2g}  {unit}")
        if self.mounting:
            turned = _with_errors(np.degrees(found.rotation), np.degrees(found.rotation_stderr))
            lines.append(f"sensor turned by {turned} deg")
        if self.gravity:
            lines.append(f"gravity {_with_errors(found.gravity, found.gravity_stderr)} m/s^2")
        lines.append(
            f"likelihood gained: {found.gain:.1f} nats; condition number of the excitation: {found.condition:.0f}"
        )
        if found.unexcited:
            poor = ", ".join(found.unexcited)
            lines.append(f"this motion does not excite: {poor} (turn the wrist more, or accelerate more)")
        return "\n".join(lines)


@in_float64
def identify_tool(
    setup: Setup, log: Log, *, mounting: bool = False, gravity: bool = False, unchecked: bool = False
) -> IdentifyResult:
    """Find the tool's mass, centre of mass and inertia, physically consistent, jointly with the bias.

    Computes in float64 whatever JAX's setting is, and keeps compiled programs in the user's cache folder
    (``FTBIAS_CACHE=off`` does not).

    Args:
        setup: robot, sensor, noise, and a tool to start from.
        log: of free motion that turns the wrist, as ``read_log`` gives it.
        mounting: also find how the sensor is turned on the flange.
        gravity: also find the direction of gravity in the base frame; its size is kept.
        unchecked: do not look first whether the setup can be right (``check_setup``).

    Returns:
        the setup found, with values in kg, m, kg m^2 about the centre of mass, sensor axes.

    Raises:
        SetupError: the setup is wrong in more than the tool, as the log shows. LogError: the log is in units or frames
            that no setup states.
    """
    require_right(setup, [log], "identify", unchecked)
    options = Options(joint_model=setup.joints.model)
    params = filter_log.likeliest_params(setup, samples_from_log(log), options)
    samples = samples_from_log(filter_log.without_useless(log, params))
    found = identify(params, samples, options, mounting, gravity)
    comments = {**setup.comments, **_comments(found, mounting, gravity)}
    return IdentifyResult(replace(_with_tool(setup, found), comments=comments), found, mounting, gravity)


def _with_tool(setup: Setup, found: Identified) -> Setup:
    turned = setup.sensor.rotation @ np.asarray(rotation_from_vector(found.rotation))
    tool = replace(setup.tool, mass=found.values[0], center_of_mass=found.values[1:4], inertia=found.values[4:])
    return replace(
        setup,
        tool=tool,
        sensor=replace(setup.sensor, rotation=turned),
        robot=replace(setup.robot, gravity=found.gravity),
    )


def _comments(found: Identified, mounting: bool, gravity: bool) -> dict[str, str]:
    comments = {
        "tool.mass": f"kg, identified ± {found.stderr[0]:.2g}",
        "tool.center_of_mass": f"m, sensor frame, identified ± {_plain(found.stderr[1:4])}",
        "tool.inertia": f"kg m^2, about the centre of mass, identified ± {_plain(found.stderr[4:])}",
    }
    if mounting:
        turned = _with_errors(found.rotation, found.rotation_stderr)
        comments["sensor.rotation_rpy"] = f"turned by the identified {turned}"
    if gravity:
        comments["robot.gravity"] = f"identified ± {_plain(found.gravity_stderr)}"
    return comments


def _plain(values: np.ndarray) -> str:
    return " ".join(f"{x:.2g}" for x in values)


def _with_errors(values: np.ndarray, stderr: np.ndarray) -> str:
    return ", ".join(f"{x:.4g} ± {e:.2g}" for x, e in zip(values, stderr, strict=True))
