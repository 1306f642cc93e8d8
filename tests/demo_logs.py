"""Logs of the demonstration's robot, with any effects: 20 s at 200 Hz."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.io.log import Log
from ftbias_jax.model import simulate, trajectories
from ftbias_jax.model.effects.types import Values
from ftbias_jax.model.params import Params
from ftbias_jax.types import Array

T = np.arange(4000) / 200.0


def recorder(params: Params, seed: int, temperature: Array | None = None) -> Callable[[Values | None], Log]:
    """(effects or None) -> the log of one motion with these effects, always with the same noise."""
    trajectory = trajectories.excitation_sines(
        jax.random.key(seed),
        jnp.array(T),
        jnp.array(trajectories.FRANKA_CENTER),
        jnp.array(trajectories.FRANKA_EXCURSION),
    )

    def record(effects: Values | None) -> Log:
        made = simulate.simulate(jax.random.key(seed + 1), params, trajectory, effects, temperature)
        recorded = np.full(len(T), np.nan) if temperature is None else temperature
        return Log(*(np.asarray(x) for x in (made.t, made.q, made.dq, made.wrench, recorded)))

    return record
