"""The bias as parameters of ros2_control's force_torque_sensor_broadcaster, which corrects the live reading with it."""

from __future__ import annotations

import json
import math

from ftbias_jax.errors import printable
from ftbias_jax.setup.export.options import number
from ftbias_jax.setup.types import REPORTS
from ftbias_jax.types import Array

BROADCASTER = "force_torque_sensor_broadcaster"


def dump_offsets(bias: Array, reports: str = REPORTS[0], remark: str = "") -> str:
    """YAML text with the offsets that the broadcaster adds to each reading.

    The broadcaster publishes reading + offset (and multiplies afterwards, by 1 unless told otherwise). The bias is what
    is added to the wrench on the tool, so the offset *is* the bias; a sensor that reports the wrench on itself reads
    the opposite sign, and so its offset is minus the bias.

    Args:
        bias: (6,) N and Nm, the report's sign: unbiased = measured + bias.
        reports: one of REPORTS, as in the setup.
        remark: a line on where the bias comes from.

    Raises:
        ValueError: a bias is not finite, or reports is none of REPORTS.
    """
    if not all(math.isfinite(value) for value in bias) or reports not in REPORTS:
        raise ValueError(f"no offsets for the bias {bias} of a sensor that reports {reports!r}")
    sign = -1.0 if reports == "wrench_on_sensor" else 1.0
    values = [number(sign * float(value)) for value in bias]
    comment = [f"# {printable(remark)}"] if remark else []
    lines = [
        *comment,
        f"{json.dumps(BROADCASTER)}:",
        "  ros__parameters:",
        "    offset:  # N, Nm: added to the reading",
    ]
    for name, numbers in (("force", values[:3]), ("torque", values[3:])):
        lines.append(f"      {name}: {{x: {numbers[0]}, y: {numbers[1]}, z: {numbers[2]}}}")
    return "\n".join(lines) + "\n"
