"""Words for units behind the names of columns, such as ``Fx [lbf]`` or ``time_ms``, and what a setup calls them."""

from __future__ import annotations

from collections.abc import Mapping

UNITS: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "time": (
        "log.time_unit",
        {
            **dict.fromkeys(("s", "sec", "secs", "seconds"), "s"),
            **dict.fromkeys(("ms", "msec", "milliseconds"), "ms"),
            **dict.fromkeys(("us", "usec", "µs", "microseconds"), "us"),
            **dict.fromkeys(("ns", "nsec", "nanoseconds"), "ns"),
        },
    ),
    "angle": (
        "log.angle_unit",
        {
            **dict.fromkeys(("rad", "radians", "rad/s", "radps"), "rad"),
            **dict.fromkeys(("deg", "degrees", "°", "deg/s", "°/s", "dps"), "deg"),
        },
    ),
    "acceleration": ("log.acceleration_unit", {"m/s^2": "m/s^2", "m/s2": "m/s^2", "m/s²": "m/s^2", "g": "g"}),
    "force": ("log.force_unit", {"n": "N", "kn": "kN", "mn": "mN", "lbf": "lbf", "kgf": "kgf"}),
    "torque": (
        "log.torque_unit",
        {
            **dict.fromkeys(("nm", "n m", "n*m", "n.m", "n-m", "n·m"), "Nm"),
            **dict.fromkeys(("nmm", "n mm", "n-mm", "mnm"), "Nmm"),
            **dict.fromkeys(("ncm", "n-cm"), "Ncm"),
            **dict.fromkeys(("lbf-in", "lbf in", "lbf.in", "in-lbf"), "lbf-in"),
            **dict.fromkeys(("lbf-ft", "lbf ft", "ft-lbf"), "lbf-ft"),
        },
    ),
    "temperature": ("", {"c": "", "°c": "", "degc": "", "celsius": "", "k": "", "kelvin": ""}),
    "length": ("", {"m": ""}),
}
"""Dimension -> the key of a setup that states the unit, and words for units -> its values."""
DIMENSIONS: Mapping[str, str] = {
    "time": "time",
    "temperature": "temperature",
    "position": "angle",
    "velocity": "angle",
    "gyroscope": "angle",
    "accelerometer": "acceleration",
    "place": "length",
}
"""Quantity -> dimension; a wrench has two, and orientations none."""
