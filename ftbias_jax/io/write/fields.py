"""Unit, meaning and requirement of each array of a result, as stated in the files and the documentation."""

from typing import NamedTuple

from ftbias_jax.types import AXES

SIGN = (
    "wrenches are what the sensor exerts on the tool, in the sensor frame, torques about its origin; "
    "wrench_unbiased = reading + bias, so bias is minus the usual offset"
)
"""Sign convention, stated in every file."""
SMOOTH, ADAPT = "smooth", "adapt"
"""Requirement of a field: smoothing was requested, or the noise was estimated from the log."""


class Field(NamedTuple):
    """One array of a result."""

    unit: str
    """Unit of all columns, or those of the force and the torque, separated by a comma."""
    meaning: str
    needs: str = ""
    """SMOOTH or ADAPT, without which the field is absent; "" = always present."""


_WRENCH, _RATE = "N, Nm", "N/s, Nm/s"

FIELDS: dict[str, Field] = {
    "t": Field("s", "stamp, as recorded"),
    "bias": Field(_WRENCH, "added to the reading it gives the corrected wrench"),
    "drift": Field(_RATE, "rate of change of the bias"),
    "bias_std": Field(_WRENCH, "standard deviation of bias"),
    "drift_std": Field(_RATE, "standard deviation of drift"),
    "wrench_unbiased": Field(_WRENCH, "reading + bias; NaN = not measured"),
    "q": Field("rad", "smoothed joint position (m if prismatic)"),
    "dq": Field("rad/s", "smoothed joint velocity (m/s if prismatic)"),
    "ddq": Field("rad/s^2", "smoothed joint acceleration (m/s^2 if prismatic)"),
    "ddq_std": Field("rad/s^2", "standard deviation of ddq (m/s^2 if prismatic)"),
    "wrench_tool": Field(_WRENCH, "what the tool must cause by its weight and motion, with the effects of the setup"),
    "innovation": Field(_WRENCH, "prediction error of the measured bias; NaN = not measured, or not used"),
    "nis": Field("1", "normalised innovation squared, summed over the axes that were used"),
    "log_likelihood": Field("nats", "of joints and wrench over the whole log"),
    "innovation_std": Field(_WRENCH, "standard deviation of innovation, with the noise that the log shows"),
    "used": Field("1", "whether the sample changed the bias: it passed the gate, and nothing touched the tool", ADAPT),
    "reading_std": Field(_WRENCH, "how far a reading is off wrench_tool - bias by all its noise", ADAPT),
    "slow_error": Field(_WRENCH, "of wrench_tool - reading what is correlated noise, not bias", ADAPT),
    "contact_wrench": Field(_WRENCH, "exerted on the tool by the environment: wrench_tool - wrench_unbiased", ADAPT),
    "contact_wrench_std": Field(_WRENCH, "standard deviation of contact_wrench, by bias_std and reading_std", ADAPT),
    "in_contact": Field("1", "whether the sample is in an interval of contact, found in the whole log", ADAPT),
    "bias_smooth": Field(_WRENCH, "bias given the whole log, past and future", SMOOTH),
    "drift_smooth": Field(_RATE, "drift given the whole log", SMOOTH),
    "bias_smooth_std": Field(_WRENCH, "standard deviation of bias_smooth", SMOOTH),
    "drift_smooth_std": Field(_RATE, "standard deviation of drift_smooth", SMOOTH),
}
"""Name -> description of the array, in the order of the files."""

LOG_UNITS = {name: FIELDS[name].unit for name in ("t", "q", "dq", "ddq", "bias", "drift", "wrench_tool")} | {
    "wrench": _WRENCH,
    "wrench_clean": _WRENCH,
    "temperature": "deg C",
    "position": "m",
    "angular_velocity": "rad/s",
    "specific_force": "m/s^2",
}
"""Units of the arrays of a log and of its ground truth; for a wrench, those of force and torque."""


def unit_of(name: str, column: int = 0) -> str:
    """Unit of one column of an array, 0 to 5 for a wrench; "" if the array is unknown."""
    if name not in FIELDS:
        return ""
    force, _, torque = FIELDS[name].unit.partition(", ")
    return torque if torque and column >= len(AXES) // 2 else force
