"""Keys of the sections that speak of noise: bias, data_noise, joints."""

from __future__ import annotations

from ftbias_jax.setup.fields import NOT_NEGATIVE, POSITIVE, Range
from ftbias_jax.setup.keys.key import PER_JOINT, Key, Kind, SectionKeys, number, numbers, text
from ftbias_jax.setup.types import DATA_NOISE_UNITS, JOINT_MODELS

AT_LEAST_ONE = Range("1 or more", 1.0)  # standard deviations: a narrower gate would keep good samples out
ENTRIES = 36
"""Entries of D, the data matrix with W = D theta, that are not always zero."""
WRENCH, WRENCH_DENSITY, WRENCH_RATE = "N, Nm", "N/s^1.5, Nm/s^1.5", "N/s, Nm/s"

BIAS = SectionKeys(
    "What is expected of the bias before the log is read. Six numbers each, or two (force, torque), or one.",
    {
        "noise_density": numbers(
            "sigma_Q, how fast the drift changes", WRENCH_DENSITY, 6, expand=True, within=POSITIVE, default=(2e-4, 1e-5)
        ),
        "initial_std": numbers(
            "how large the bias may be at the start: square root of P_0",
            WRENCH,
            6,
            expand=True,
            within=POSITIVE,
            default=(5.0, 0.5),
        ),
        "initial_drift_std": numbers(
            "how large the drift may be at the start",
            WRENCH_RATE,
            6,
            expand=True,
            within=NOT_NEGATIVE,
            default=(0.01, 5e-4),
        ),
        "initial": numbers(
            "bias expected at the start",
            f"{WRENCH}; unbiased = measured + bias",
            6,
            expand=True,
            default=(0.0, 0.0),
        ),
        "initial_drift": numbers("drift expected at the start", WRENCH_RATE, 6, expand=True, default=(0.0, 0.0)),
        "gate": number(
            "wrenches farther than this off their prediction are not used; 5 is usual",
            "standard deviations",
            within=AT_LEAST_ONE,
            absent="6, or none if `adapt = false`",
            example=5.0,
        ),
        "drift_time": numbers(
            "time in which the drift reverts to zero",
            "s",
            6,
            expand=True,
            within=POSITIVE,
            absent="never",
            example=(600.0,),
        ),
        "adapt": Key(Kind.FLAG, "take contact, and the noise that the setup leaves open, from each log", default=True),
    },
)
DATA_NOISE = SectionKeys(
    "Sigma_D: how well the motion that moves the tool is known. One number each, or three for the axes of the sensor.",
    {
        **{
            key: numbers(
                f"standard deviation of the {key.replace('_', ' ')}",
                unit,
                3,
                expand=True,
                within=NOT_NEGATIVE,
                default=(0.0,),
            )
            for key, unit in DATA_NOISE_UNITS.items()
        },
        "entries": numbers(
            "36 standard deviations of the live entries of D instead",
            "of the entries of D",
            ENTRIES,
            within=NOT_NEGATIVE,
            absent="none",
            example=(0.01,) * ENTRIES,
        ),
    },
)
JOINTS = SectionKeys(
    "Noise of the encoders and of the motion. One number, or one per joint.",
    {
        "model": text("what noise drives a joint", choices=JOINT_MODELS, default=JOINT_MODELS[0]),
        "process_noise_density": numbers(
            "how fast the acceleration may change; filtering takes 8 times as much, because the filter must not lag",
            "rad/s^2.5 for integrated_jerk",
            PER_JOINT,
            expand=True,
            within=POSITIVE,
            absent="the likeliest of the log",
            example=(10.0,),
        ),
        "position_noise_std": numbers(
            "of a measured position", "rad", PER_JOINT, expand=True, within=POSITIVE, default=(2e-5,)
        ),
        "velocity_noise_std": numbers(
            "of a measured velocity", "rad/s", PER_JOINT, expand=True, within=POSITIVE, default=(1e-3,)
        ),
        "initial_std": numbers(
            "of position, velocity and acceleration at the start; wide enough for a log that starts in motion",
            "rad, rad/s, rad/s^2",
            3,
            within=NOT_NEGATIVE,
            default=(1.0, 1.0, 10.0),
        ),
    },
)
