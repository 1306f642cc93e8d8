"""Every key of a setup, section by section."""

from __future__ import annotations

import re
from collections.abc import Mapping

from ftbias_jax.setup.keys.bodies import FLANGE, JOINT, ROBOT, SENSOR, SENSOR_POSE, TOOL
from ftbias_jax.setup.keys.key import Key, SectionKeys
from ftbias_jax.setup.keys.noise import BIAS, DATA_NOISE, JOINTS
from ftbias_jax.setup.keys.recording import CLOCKS, COLUMNS, FILES, LOG, TIME_OFFSETS, TIME_UNITS_OF_FILES, TOPICS

SECTIONS: Mapping[str, SectionKeys] = {
    "robot": ROBOT,
    "robot.joints": JOINT,
    "robot.flange": FLANGE,
    "sensor": SENSOR,
    "sensor_pose": SENSOR_POSE,
    "tool": TOOL,
    "bias": BIAS,
    "joints": JOINTS,
    "data_noise": DATA_NOISE,
    "log": LOG,
    "log.columns": COLUMNS,
    "log.topics": TOPICS,
    "log.clocks": CLOCKS,
    "log.files": FILES,
    "log.time_units": TIME_UNITS_OF_FILES,
    "log.time_offsets": TIME_OFFSETS,
}
"""By the full name of the section. [effects.NAME] is not here: its keys are those of the catalogue of effects."""
EFFECTS = "effects"
"""The section whose keys are those of the catalogue of effects."""


def top_sections() -> tuple[str, ...]:
    """The names that may stand at the top of a setup."""
    return (*(name for name in SECTIONS if "." not in name), EFFECTS)


def further_columns(columns: Mapping[str, str | tuple[str, ...]]) -> dict[str, str]:
    """Columns that effects see by a name of the owner's choice: their name in the file.

    Args:
        columns: [log.columns] of a setup.
    """
    named = {key: name for key, name in columns.items() if key not in COLUMNS.keys}
    return {key: name for key, name in named.items() if isinstance(name, str)}


def section_keys(name: str) -> SectionKeys:
    """The section of a full name such as ``robot.joints[2]``."""
    return SECTIONS[re.sub(r"\[\d+\]", "", name)]


def key_of(full_name: str) -> Key | None:
    """The key of a full name such as ``tool.mass``; None if the table does not have it."""
    section, _, key = full_name.rpartition(".")
    keys = SECTIONS.get(re.sub(r"\[\d+\]", "", section))
    return keys.keys.get(key) if keys else None
