"""Maximum likelihood over any positive leaves of the parameters by their gradient, and what the data say about each.

For the noise of independent filters newton.py is far faster; this is for everything else, such as the 36 variances of
Sigma_D, most of which no log with a constant tool can tell apart (errata 11).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
import optax

from ftbias_jax.calibration.newton import standard_errors
from ftbias_jax.types import Array

Score = Callable[[Any], Array]
"""Pytree of positive arrays -> () nats."""


class Ascent(NamedTuple):
    """Where L-BFGS stopped. P = numbers in all leaves together."""

    values: Any
    """The pytree."""
    relative_stderr: np.ndarray
    """(P,) in the order of ravel_pytree; inf for what the data leave open."""
    information: np.ndarray
    """(P, P) observed Fisher information of the logarithms."""
    determined: int
    """How many combinations of the logarithms the data determine to better than a factor e."""
    value: float
    start_value: float
    iterations: int


def maximise(score: Score, start: Any, iterations: int = 100, small: float = 1e-4) -> Ascent:
    """L-BFGS with a zoom line search (optax) on the logarithms.

    Args:
        score: log-likelihood, differentiable.
        start: pytree of positive arrays, such as a dict of leaves of Params.
        iterations: at most.
        small: nats; stops when an iteration gains less.
    """
    flat, unravel = jax.flatten_util.ravel_pytree(jax.tree.map(jnp.log, start))

    def loss(logs: Array) -> Array:
        return -score(jax.tree.map(jnp.exp, unravel(logs)))

    solver = optax.lbfgs()
    value_and_slope = optax.value_and_grad_from_state(loss)

    @jax.jit
    def advance(logs: Array, state: Any) -> tuple[Array, Any, Array]:
        value, slope = value_and_slope(logs, state=state)
        updates, state = solver.update(slope, state, logs, value=value, grad=slope, value_fn=loss)
        return optax.apply_updates(logs, updates), state, value

    logs, state = flat, solver.init(flat)
    values: list[float] = []
    for _ in range(iterations):
        logs, state, value = advance(logs, state)
        values.append(float(value))
        if len(values) > 1 and values[-2] - values[-1] < small:
            break
    information = np.asarray(jax.jit(jax.jacfwd(jax.grad(loss)))(logs))
    information = (information + information.T) / 2
    return Ascent(
        values=jax.tree.map(jnp.exp, unravel(logs)),
        relative_stderr=standard_errors(information),
        information=information,
        determined=int((np.linalg.eigvalsh(information) > 1).sum()),
        value=-float(loss(logs)),
        start_value=-values[0],
        iterations=len(values),
    )
