"""What a simulated robot does: motions that suit it, a log replayed, and what else effects look at."""

from __future__ import annotations

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np

from ftbias_jax.errors import UsageError
from ftbias_jax.io.log import Log
from ftbias_jax.model import trajectories
from ftbias_jax.model.effects.table import Catalogue
from ftbias_jax.model.effects.types import Values
from ftbias_jax.model.pose_log import tumbling, with_positions
from ftbias_jax.model.trajectories import Trajectory
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

FRANKA_CENTER = (0.0, -0.6, 0.0, -2.0, 0.0, 1.8, 0.8)  # rad, a pose with the tool in front of the arm
FRANKA_EXCURSION = (0.8, 0.5, 0.8, 0.5, 1.2, 1.0, 1.5)  # rad, within the joint limits around it
MOST_SAMPLES = 100_000_000
"""Of one simulated log: a day at 1 kHz."""
EXCURSION = (0.8, 0.1)  # rad, m: of the joints of any other arm, around zero


def working_range(setup: Setup) -> tuple[Array, Array]:
    """Center and excursion (n,) rad of a sensible motion of the robot."""
    if setup.robot.model.split("_")[0] in ("panda", "fr3"):
        return np.array(FRANKA_CENTER), np.array(FRANKA_EXCURSION)
    revolute = np.abs(setup.robot.screws[:, 3:]).sum(1) > 0
    excursion = np.where(revolute, *EXCURSION)
    if setup.robot.position_limits is None:
        return np.zeros(len(revolute)), excursion
    lowest, highest = setup.robot.position_limits.T
    excursion = np.minimum(excursion, (highest - lowest) / 2)
    return np.clip(0.0, lowest + excursion, highest - excursion), excursion


def trajectory_of(setup: Setup, motion: str | Log, duration: float, rate: float, key: Array) -> Trajectory:
    """The motion that is asked for."""
    if isinstance(motion, Log):
        return trajectories.replay(motion if setup.pose is None else with_positions(motion))
    t = jnp.arange(max(round(duration * rate), 2)) / rate
    generate = trajectories.excitation_sines if motion == "sines" else trajectories.minimum_jerk_moves
    if setup.pose is not None:
        return tumbling(generate, key, t, len(setup.robot.joint_names))
    center, excursion = working_range(setup)
    made: Trajectory = generate(key, t, jnp.asarray(center), jnp.asarray(excursion))
    return made


def check_motion(duration: float, rate: float, motion: str | Log) -> None:
    """Refuse a motion that is not known, and lengths that are none."""
    if not isinstance(motion, Log) and motion not in ("sines", "moves"):
        raise UsageError(f"got {motion!r}", field="motion", remedy="give 'sines', 'moves', or a log that read_log read")
    for name, value in {"duration": duration, "rate": rate}.items():
        if not 0 < value < float("inf"):
            raise UsageError(f"must be a positive number, not {value!r}", field=name)
    if duration * rate > MOST_SAMPLES:
        remedy = f"ask for at most {MOST_SAMPLES} samples: seconds times rate"
        raise UsageError(f"{duration * rate:.3g} samples do not fit the memory", field="duration", remedy=remedy)


def columns_of(columns: Mapping[str, Array] | None, motion: str | Log, t: Array) -> dict[str, Array]:
    """(T,) further quantities at the stamps."""
    if columns is None:
        return {name: column.at(t) for name, column in motion.columns.items()} if isinstance(motion, Log) else {}
    made = {name: np.asarray(values, float) for name, values in columns.items()}
    for name, values in made.items():
        if values.shape != t.shape or not np.isfinite(values).all():
            message = f"has shape {values.shape}, or numbers that are not finite, for {len(t)} stamps"
            raise UsageError(message, field=f"columns: {name}", remedy="give one finite number per sample")
    return made


def check_needs(catalogue: Catalogue, values: Values, columns: Mapping[str, Array]) -> None:
    """Refuse effects that look at a quantity which nobody gave."""
    for name in (name for name in values if name in catalogue):
        for need in catalogue[name].needs:
            if need != "temperature" and need not in columns:
                remedy = "give it by columns={...}, or replay a log that has it (motion)"
                raise UsageError(f"needs the column {need!r}", field=f"effects: {name}", remedy=remedy)
