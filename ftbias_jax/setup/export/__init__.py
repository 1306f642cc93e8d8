"""Export of an identified tool to robot controllers and ROS: payloads, and parameters of gravity compensation."""

import os
from collections.abc import Callable
from typing import Any

from ftbias_jax.errors import UsageError
from ftbias_jax.setup.export.payload import DEFAULT, ExportOptions, franka_text, ur_text, with_effects_in_keys
from ftbias_jax.setup.export.ros import ft_calib_text, ros_text
from ftbias_jax.setup.save import write_text
from ftbias_jax.setup.types import Setup

FORMATS: dict[str, Callable[[Setup, ExportOptions], str]] = {
    "ur": ur_text,
    "franka": franka_text,
    "ros": ros_text,
    "ft_calib": ft_calib_text,
}
"""Name of a format -> function that returns its text."""


def export_text(setup: Setup, name: str, options: ExportOptions = DEFAULT) -> str:
    """Return the text of one format.

    Args:
        setup: with the tool, as ``identify`` writes it.
        name: key of FORMATS.
        options: what a setup does not state.

    Raises:
        UsageError: there is no such format. SetupError: the setup does not state the tool, or not how the sensor's
            frame relates to the one that the format needs.
    """
    if name not in FORMATS:
        raise UsageError(f"there is no format {name!r}", field="format", remedy=f"choose from {', '.join(FORMATS)}")
    return FORMATS[name](with_effects_in_keys(setup), options)


def save_export(setup: Setup, path: str | os.PathLike[str], format: str, **options: Any) -> None:
    """Write the tool, and for ROS the bias, in the format of a robot's controller or of a ROS package.

    The file is written whole or not at all. ``Setup.export`` is this function.

    Args:
        setup: with the tool.
        path: the file to make or replace.
        format: "ur" (URScript), "franka" (JSON of setLoad), "ros" (YAML for ros2_control) or "ft_calib" (YAML).
        **options: fields of ``setup.export.payload.ExportOptions``: sensor_mass, frames_as_stated, sensor_frame,
            world_frame.

    Raises:
        OutputError: the file cannot be written. UsageError, SetupError: as for ``export_text``.
    """
    write_text(path, export_text(setup, format, ExportOptions(**options)))
