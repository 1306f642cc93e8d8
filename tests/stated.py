"""Setups that tests in several folders use, as tables."""

from ftbias_jax.setup import Setup, parse_setup

PANDA = {
    "robot": {"model": "panda"},
    "sensor": {"noise_std": [0.1, 0.004]},
    "tool": {"mass": 0.9, "center_of_mass": [0.01, 0.0, 0.06]},
}
YAW_PITCH_ROLL = {
    "robot": {
        "joints": [
            {"axis": [0, 0, 1], "point": [0, 0, 0], "name": "yaw"},
            {"axis": [0, 1, 0], "point": [0, 0, 0.3], "name": "pitch"},
            {"axis": [1, 0, 0], "point": [0, 0, 0.5], "name": "roll"},
        ],
        "flange": {"translation": [0.1, 0, 0.6]},
    },
    "sensor": {"noise_std": [0.1, 0.004]},
    "tool": {"mass": 0.7, "center_of_mass": [0.01, 0, 0.06], "inertia": [0.002, 0, 0, 0.002, 0, 0.001]},
    "joints": {"position_noise_std": 1e-4, "velocity_noise_std": 1e-3},
}
"""A small arm that turns its tool in all directions."""
MOUNTED = {
    "sensor": {"noise_std": [0.1, 0.004], "translation": [0.01, -0.02, 0.05], "rotation_rpy": [0.1, -0.2, 0.7]},
    "tool": YAW_PITCH_ROLL["tool"],
}
"""A sensor that is mounted at an oblique angle."""


def pose_setup(*, tables=(), **pose) -> Setup:
    """The setup of a recorded pose, with keys of [sensor_pose], and further or other tables."""
    return parse_setup({**MOUNTED, "sensor_pose": pose, **dict(tables)})
