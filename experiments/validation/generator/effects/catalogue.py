"""Tables of the effects inside and outside the package's catalogue: builder and functional forms."""

from __future__ import annotations

from validation.generator.effects import loads, mechanical, sensing, slow, timing
from validation.generator.effects.effect import Builder

Entry = tuple[Builder, tuple[str, ...]]

LISTED: dict[str, Entry] = {
    "tool_mass": (mechanical.tool_mass, ("denser", "point_at_com")),
    "tool_com": (mechanical.tool_com, ("any_direction", "sideways")),
    "tool_inertia": (mechanical.tool_inertia, ("larger", "rod")),
    "gravity_tilt": (mechanical.gravity_tilt, ("any_direction", "one_axis")),
    "mount_rotation": (mechanical.mount_rotation, ("sensor_axes", "sensor_and_tool")),
    "encoder_offset": (mechanical.encoder_offset, ("constant", "eccentric")),
    "joint_flexibility": (mechanical.joint_flexibility, ("one_joint", "all_joints")),
    "gain": (sensing.gain, ("scattered", "one_channel", "force_channels")),
    "crosstalk": (sensing.crosstalk, ("sparse", "mutual", "full")),
    "time_delay": (timing.time_delay, ("constant", "clock_skew")),
    "low_pass": (sensing.low_pass, ("first_order", "butterworth", "moving_average")),
    "saturation": (sensing.saturation, ("clip", "one_sided", "force_only")),
    "quantisation": (sensing.quantisation, ("round", "truncate", "coarse_force")),
    "hysteresis": (sensing.hysteresis, ("play", "bouc_wen", "maxwell_slip")),
    "noise_level": (sensing.noise_level, ("louder", "some_channels", "heavy_tailed", "quieter")),
    "outliers": (sensing.outliers, ("fixed_size", "whole_sample", "spread")),
    "warmup": (slow.warmup, ("exponential", "two_exponentials")),
    "bias_jump": (slow.bias_jump, ("step", "ramp", "settling")),
    "temperature_drift": (slow.temperature_drift, ("instant", "lagging", "curved")),
    "cable": (mechanical.cable, ("forearm", "world", "stiffening")),
    "contact": (loads.contact, ("half_sine", "trapezoid", "decay", "press")),
    "tool_flexibility": (mechanical.tool_flexibility, tuple(mechanical.FLEXIBLE)),
    "stamp_jitter": (timing.stamp_jitter, ("gaussian", "latency", "bursts")),
    "dropped_samples": (timing.dropped_samples, ("rows", "repeats", "nan", "gaps")),
    "vibration": (sensing.vibration, ("squared", "straight", "meshing")),
}
"""Effects named as in the package's catalogue."""

UNLISTED: dict[str, Entry] = {
    "slosh": (loads.slosh, ("pendulum",)),
    "drag": (loads.drag, ("square",)),
    "eddy": (loads.drag, ("linear",)),
    "magnet": (loads.magnet, ("attraction",)),
    "load_nonlinearity": (sensing.bent, ("quadratic", "cubic")),
    "gear_ripple": (sensing.gear_ripple, ("joint_locked",)),
    "mains_hum": (slow.mains_hum, ("50_hz",)),
    "joint_heat": (slow.joint_heat, ("hidden",)),
    "wandering_bursts": (slow.wandering_bursts, ("random_walk",)),
}
"""Effects outside the catalogue, for which the right verdict is unknown or partly explained."""

ENTRIES = LISTED | UNLISTED

STATISTICAL = ("saturation", "quantisation", "noise_level", "outliers", "dropped_samples", "vibration")
"""Effects whose strength is not a mean gap, so their sizes are used as drawn."""

NEEDS_MOTION = ("tool_inertia", "tool_flexibility", "time_delay", "low_pass", "stamp_jitter", "drag", "eddy", "slosh")
"""Effects that slow motion does not reveal, so their logs have brisk motion."""

TWINS = (
    {"gain", "tool_mass"},
    {"gain", "crosstalk"},
    {"tool_com", "crosstalk"},
    {"time_delay", "low_pass"},
    {"time_delay", "stamp_jitter"},
    {"low_pass", "stamp_jitter"},
    {"gravity_tilt", "mount_rotation"},
    {"gravity_tilt", "encoder_offset"},
    {"mount_rotation", "encoder_offset"},
    {"gravity_tilt", "joint_flexibility"},
    {"encoder_offset", "joint_flexibility"},
    {"mount_rotation", "crosstalk"},
    {"warmup", "temperature_drift"},
    {"noise_level", "outliers"},
    {"noise_level", "quantisation"},
    {"noise_level", "stamp_jitter"},
    {"outliers", "stamp_jitter"},
    {"noise_level", "vibration"},
    {"quantisation", "vibration"},
    {"outliers", "vibration"},
    {"stamp_jitter", "vibration"},
)
"""Pairs that are not combined in one log, because each effect hides or mimics the other."""
