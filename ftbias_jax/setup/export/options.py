"""What an export needs beside the setup, and what its first lines say."""

from __future__ import annotations

import hashlib
import os
from typing import NamedTuple

import numpy as np

from ftbias_jax import __version__
from ftbias_jax.errors import printable
from ftbias_jax.setup.save import edited_text
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array


class ExportOptions(NamedTuple):
    """What a setup does not say."""

    sensor_mass: tuple[float, float, float, float] | None = None
    """kg, and m in the robot's flange frame: mass and centre of mass of what is between flange and sensor, such as the
    sensor's own body. The robot carries it, the sensor does not feel it."""
    frames_as_stated: bool = False
    """Whether the flange of a setup with a URDF or a list of joints is the tool flange of the robot's controller, and a
    mounting of the sensor that the setup does not state is zero."""
    sensor_frame: str = "ft_sensor"
    """Frame of TF that the sensor publishes in."""
    world_frame: str = ""
    """Frame of TF that is the setup's base frame; "" = that of the robot's maker."""


DEFAULT = ExportOptions()


def heading(setup: Setup) -> list[str]:
    """Where an export comes from, in words: program, setup and its SHA-256, and what is known of its errors."""
    digest = hashlib.sha256(edited_text(setup).encode()).hexdigest()
    name = os.path.basename(setup.path) or "a setup in memory"
    words = [f"by ftbias_jax {__version__} from {name}, sha256 {digest}"]
    words += [f"{key}: {remark}" for key, remark in setup.comments.items() if key.startswith("tool.")]
    if setup.effects:
        words.append(f"not in these numbers: the effects of the setup ({', '.join(setup.effects)})")
    return [printable(line) for line in words]


def plain(values: Array) -> list[float]:
    """Numbers with twelve digits, or fifteen decimals, and no minus zero."""
    return [round(float(f"{float(value):.12g}"), 15) + 0.0 for value in values]


def number(value: float) -> str:
    """A number with a point and without an exponent, because "1e-05" is a word to YAML 1.1, which ROS reads."""
    return str(np.format_float_positional(plain([value])[0], trim="0"))


def numbers(values: Array) -> str:
    """Such numbers as a list, in YAML and URScript."""
    return f"[{', '.join(map(number, values))}]"
