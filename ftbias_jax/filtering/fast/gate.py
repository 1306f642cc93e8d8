"""The gate of the bias filter for lanes: what is off its prediction is left out, and the bias forgotten meanwhile."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from ftbias_jax.filtering.process_models import FORGET
from ftbias_jax.runtime.lanes import Rows, Vector


def screen(gate: float, x: Vector, P: Rows, dt: Array, y: Array, r: Array) -> tuple[Rows, Array, Array]:
    """``bias_filter.gated`` for lanes: the covariance, the measurement, and the share by which P_bb grew."""
    off = jnp.abs(y - x[0]) > gate * jnp.sqrt(P[0][0] + r)  # never where nothing was measured
    closed = jnp.broadcast_to(off.any(-1, keepdims=True), off.shape)
    grown = jnp.where(closed, jnp.expm1(2 * dt / FORGET), 0)
    P = [[P[0][0] + grown * _variance_of_bias(P), *P[0][1:]], *P[1:]]
    return P, jnp.where(closed, jnp.nan, y), grown


def _variance_of_bias(P: Rows) -> Array:
    """Of the bias alone: the first entry is the bias plus the correlated noise, the third the noise."""
    return P[0][0] if len(P) == 2 else P[0][0] - 2 * P[0][2] + P[2][2]


def before_growth(P: Rows, grown: Array) -> Rows:
    """Adjoint of ``_screen`` on the covariance."""
    share = P[0][0] * grown
    P = [[P[0][0] + share, *P[0][1:]], *P[1:]]
    if len(P) == 3:
        P = [[P[0][0], P[0][1], P[0][2] - share], P[1], [P[2][0] - share, P[2][1], P[2][2] + share]]
    return P
