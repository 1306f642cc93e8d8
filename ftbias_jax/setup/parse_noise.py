"""The sections of a setup that speak of noise: [bias] and [joints]."""

from __future__ import annotations

from ftbias_jax.setup.fields import NOT_NEGATIVE, POSITIVE, Range, Section, flag, scalar, subsection, text, vector
from ftbias_jax.setup.types import JOINT_MODELS, BiasSetup, JointSetup, PoseSetup

AT_LEAST_ONE = Range("1 or more", 1.0)  # standard deviations: a narrower gate would keep good samples out


def bias_section(top: Section) -> BiasSetup:
    """[bias]: the prior of the bias process."""
    keys = (
        "noise_density",
        "initial_std",
        "initial_drift_std",
        "initial",
        "initial_drift",
        "gate",
        "drift_time",
        "adapt",
    )
    section = subsection(top, "bias", keys)
    gate = scalar(section, "gate", within=AT_LEAST_ONE) if "gate" in section.values else None
    reverts = "drift_time" in section.values
    return BiasSetup(
        noise_density=vector(section, "noise_density", 6, (2e-4, 1e-5), within=POSITIVE, expand=True),
        initial_std=vector(section, "initial_std", 6, (5.0, 0.5), within=POSITIVE, expand=True),
        initial_drift_std=vector(section, "initial_drift_std", 6, (0.01, 5e-4), within=NOT_NEGATIVE, expand=True),
        initial=vector(section, "initial", 6, (0.0, 0.0), expand=True),
        initial_drift=vector(section, "initial_drift", 6, (0.0, 0.0), expand=True),
        gate=gate,
        drift_time=vector(section, "drift_time", 6, within=POSITIVE, expand=True) if reverts else None,
        adapt=flag(section, "adapt", True),
    )


def joints_section(top: Section, n: int, pose: PoseSetup | None) -> JointSetup:
    """[joints]: noise of the joint filter; n of them, or entries of a recorded pose."""
    keys = ("model", "process_noise_density", "position_noise_std", "velocity_noise_std", "initial_std")
    section = subsection(top, "joints", keys)
    position_std, velocity_std = (pose.position_noise_std, pose.velocity_noise_std) if pose else (2e-5, 1e-3)
    key = "process_noise_density"
    density = vector(section, key, n, within=POSITIVE, expand=True) if key in section.values else None
    return JointSetup(
        model=text(section, "model", JOINT_MODELS[0], JOINT_MODELS),
        process_noise_density=density,
        position_noise_std=vector(section, "position_noise_std", n, position_std, within=POSITIVE, expand=True),
        velocity_noise_std=vector(section, "velocity_noise_std", n, velocity_std, within=POSITIVE, expand=True),
        initial_std=vector(section, "initial_std", 3, (1.0, 1.0, 10.0), within=NOT_NEGATIVE),
    )
