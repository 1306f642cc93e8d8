"""Reading of [limits], the limits of planned motions."""

import numpy as np

from ftbias_jax.setup.fields import Section, show
from ftbias_jax.setup.keys.table import PER_JOINT, SECTIONS, open_section, read, read_all
from ftbias_jax.setup.types import LimitsSetup


def read_limits(top: Section, joints: int) -> LimitsSetup:
    """Read [limits] of a setup with this many joints.

    Raises:
        SetupError: a lower end is not below its upper end, an axis has no length, or a type or shape is wrong.
    """
    section = open_section(top, "limits")
    by_joint = [key for key, spec in SECTIONS["limits"].keys.items() if spec.size == PER_JOINT]
    values = {key: read(section, key, joints) for key in by_joint} | read_all(section, by_joint)
    for lower, upper in (("position_lower", "position_upper"), ("box_lower", "box_upper")):
        low, high = values[lower], values[upper]
        if low is not None and high is not None and not (low < high).all():
            raise section.error(lower, f"{show(low.tolist())} is not below {upper}", "exchange them")
    if not np.linalg.norm(values["keep_axis"]) > 0:
        raise section.error("keep_axis", "has no length", "give the axis in the sensor frame, such as [0, 0, 1]")
    return LimitsSetup(**values)
