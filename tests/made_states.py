"""Made-up motion states on which the drives of terms depend."""

import numpy as np

from ftbias_jax.model.effects.terms.types import State
from ftbias_jax.types import Array


def still_state(q: Array, position: Array) -> State:
    """Sensor axes equal base axes; one joint at q (T,) rad, one sample per second; everything else is at rest."""
    count, zero = len(q), np.zeros((len(q), 3))
    still = dict.fromkeys(("velocity", "acceleration", "angular_velocity", "angular_acceleration"), zero)
    return State(
        t=np.arange(float(count)),
        temperature=np.full(count, 20.0),
        q=q[:, None],
        dq=np.zeros((count, 1)),
        rotation=np.tile(np.eye(3), (count, 1, 1)),
        position=position,
        gravity=np.array([0.0, 0.0, -9.81]),
        load=np.ones((count, 6)),
        axes=np.tile([0.0, 0.0, 1.0], (count, 1, 1)),
        counts=np.ones(count),
        period=0.002,
        **still,
    )
