"""The three joint process models of the report, and the bias model: dt -> transition A and process noise Q.

The dt of a step is the time since the previous sample, and both A and Q use it (errata 7). dt = 0 gives A = I, Q = 0.

Each model is written once, as nested rows of entries: the textbook filter stacks them into matrices, the fast routes
(scan.py) keep the entries apart.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from ftbias_jax.runtime.lanes import Table

FORGET = 10.0
"""s: time in which the standard deviation of the bias grows e-fold while the gate lets nothing through."""
Rows = Table
"""A small matrix as nested lists of entries, arrays of any common shape; an entry that never changes is 0 or 1."""
ProcessModel = Callable[[Array, Any], tuple[Rows, Rows]]
"""(dt, strength) -> rows of A and rows of Q. The strength is a density, or where A depends on it, a BiasStrength."""


class BiasStrength(NamedTuple):
    """Process noise of one axis of the bias and of its time-correlated noise; arrays over B axes."""

    density: Array
    """(B,) sigma_Q, N/s^1.5 or Nm/s^1.5."""
    drift_rate: Array | None = None
    """(B,) 1/s: rate at which the drift reverts to zero, 0 = never; None = on no axis, which costs less."""
    noise_rate: Array | None = None
    """(B,) 1/s: inverse correlation time of the noise; None = all noise is white."""
    noise_variance: Array | None = None
    """(B,) N^2 or Nm^2: stationary variance of the correlated noise; it may differ from sample to sample."""
    jump: Array | None = None
    """(B,) N^2 or Nm^2: variance of a jump of the bias at a sample; None = it never jumps."""


def acceleration_noise(dt: Float[Array, " ..."], density: Float[Array, " ..."]) -> tuple[Rows, Rows]:
    """Model 1, non-integrated acceleration noise (Kubus et al. 2007), as printed: A without dt^2/2, constant Q.

    Q does not scale with dt, so results depend on the sampling rate (errata 14); it is kept for comparison.

    Args:
        dt: () s.
        density: () rad/s^2, standard deviation that the acceleration gains at every step.

    Returns:
        A and Q (3 x 3) for the state (position, velocity, acceleration).
    """
    variance = jnp.where(dt > 0, density**2, 0)  # the first sample is a correction without a prediction
    return [[1, dt, 0], [0, 1, dt], [0, 0, 1]], [[0, 0, 0], [0, 0, 0], [0, 0, variance]]


def integrated_acceleration_noise(dt: Float[Array, " ..."], density: Float[Array, " ..."]) -> tuple[Rows, Rows]:
    """Model 2, integrated acceleration noise, as printed: the noise enters the velocity but not the acceleration.

    The gain of the acceleration therefore decays to zero (errata 14); the model is kept for comparison.

    Args:
        dt: () s.
        density: () rad/s^1.5, square root of the spectral density.
    """
    (pp, pv), (_, vv) = drift_noise(dt, density)[1]
    return [[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]], [[pp, pv, 0], [pv, vv, 0], [0, 0, 0]]


def integrated_jerk_noise(dt: Float[Array, " ..."], density: Float[Array, " ..."]) -> tuple[Rows, Rows]:
    """Model 3, integrated jerk noise: white noise on the jerk, integrated three times (Barfoot 2024). The default.

    Args:
        dt: () s.
        density: () rad/s^2.5, square root of the spectral density.
    """
    variance = density**2
    pp, pv, pa = dt**5 / 20 * variance, dt**4 / 8 * variance, dt**3 / 6 * variance
    vv, va, aa = dt**3 / 3 * variance, dt**2 / 2 * variance, dt * variance
    return [[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]], [[pp, pv, pa], [pv, vv, va], [pa, va, aa]]


def drift_noise(dt: Float[Array, " ..."], density: Float[Array, " ..."]) -> tuple[Rows, Rows]:
    """One axis of the bias: its rate is integrated white noise (report, eq. of Q_i in section 3).

    Args:
        dt: () s.
        density: () sigma_Q, N/s^1.5 or Nm/s^1.5.

    Returns:
        A and Q (2 x 2) for the state (bias, drift).
    """
    variance = density**2
    cross = dt**2 / 2 * variance
    return [[1, dt], [0, 1]], [[dt**3 / 3 * variance, cross], [cross, dt * variance]]


def reverting_drift(dt: Array, strength: BiasStrength) -> tuple[Rows, Rows]:
    """One axis of the bias whose drift is an Ornstein-Uhlenbeck process: it reverts to zero and forecasts better.

    With rate 0 it is ``drift_noise``. With a reversion time far below the log's length the bias becomes a random walk.
    A and Q (2 x 2) are for the state (bias, drift) after dt () s.
    """
    density, rate = strength.density, strength.drift_rate
    dt, jumped = dt + jnp.zeros_like(density), 0 if strength.jump is None else strength.jump
    if rate is None:
        A, ((bias, cross), (_, drift)) = drift_noise(dt, density)
        return A, [[bias + jumped, cross], [cross, drift]]
    x = rate * dt
    moved = dt * _phi(x)
    variance = density**2
    cross = moved**2 / 2 * variance
    Q = [[dt**3 * _integrated_twice(x) * variance + jumped, cross], [cross, dt * _phi(2 * x) * variance]]
    return [[1, moved], [0, jnp.exp(-x)]], Q


def correlated_bias(dt: Array, strength: BiasStrength) -> tuple[Rows, Rows]:
    """``reverting_drift`` with first-order Gauss-Markov noise added to the bias.

    The state is (bias + noise, drift, noise), whose first entry is measured. A and Q (3 x 3) are for dt () s;
    ``strength`` must state the rate and the variance of the noise.
    """
    assert strength.noise_rate is not None
    assert strength.noise_variance is not None
    ((_, moved), (_, reverted)), ((bias, cross), (_, drift)) = reverting_drift(dt, strength)
    forgotten = -jnp.expm1(-strength.noise_rate * dt)
    noise = strength.noise_variance * forgotten * (2 - forgotten)
    A: Rows = [[1, moved, -forgotten], [0, reverted, 0], [0, 0, 1 - forgotten]]
    return A, [[bias + noise, cross, noise], [cross, drift, 0], [noise, 0, noise]]


def _phi(x: Array) -> Array:
    """(1 - exp(-x)) / x, for x >= 0; 1 at 0, with finite derivatives."""
    small = x < 1e-4
    safe = jnp.where(small, 1, x)
    return jnp.where(small, 1 - x / 2 + x**2 / 6, -jnp.expm1(-safe) / safe)


def _integrated_twice(x: Array) -> Array:
    """(x - 2 (1 - exp(-x)) + (1 - exp(-2 x)) / 2) / x^3, for x >= 0; by its series (to 1e-13) where terms cancel."""
    small = x < 0.5
    safe, near = jnp.where(small, 1, x), jnp.where(small, x, 0)
    series, factorial = jnp.zeros_like(x), 2.0
    for n in range(3, 19):
        factorial *= n
        series = series + (-near) ** (n - 3) * (2 ** (n - 1) - 2) / factorial
    return jnp.where(small, series, (safe + 2 * jnp.expm1(-safe) - jnp.expm1(-2 * safe) / 2) / safe**3)


def bias_model(strength: BiasStrength | Array) -> ProcessModel:
    """Process model of one axis, with as few states as its strength, or density (B,) in N/s^1.5, Nm/s^1.5, requires."""
    if not isinstance(strength, BiasStrength):
        return drift_noise
    return reverting_drift if strength.noise_rate is None else correlated_bias


@dataclass(frozen=True)
class Gated:
    """A process model of the bias whose measurements pass a gate: see ``bias_filter.step``."""

    model: ProcessModel
    gate: float
    """Threshold in standard deviations."""

    def __call__(self, dt: Array, strength: Any) -> tuple[Rows, Rows]:
        """A and Q of the model itself."""
        return self.model(dt, strength)


JOINT_MODELS: dict[str, ProcessModel] = {
    "acceleration": acceleration_noise,
    "integrated_acceleration": integrated_acceleration_noise,
    "integrated_jerk": integrated_jerk_noise,
}


def bias_drift_noise(
    dt: Float[Array, ""], density: Float[Array, " 6"]
) -> tuple[Float[Array, "12 12"], Float[Array, "12 12"]]:
    """The bias model of all six axes as the report writes it.

    Args:
        dt: () s.
        density: (6,) sigma_Q in N/s^1.5 and Nm/s^1.5, one per axis (errata 12).

    Returns:
        A (12, 12) and Q (12, 12) for the state (bias, drift).
    """
    transition, noise = drift_noise(jnp.broadcast_to(dt, density.shape), density)
    return _by_axis(transition), _by_axis(noise)


def bias_noise(dt: Array, strength: BiasStrength | Array) -> tuple[Array, Array]:
    """``bias_drift_noise``, or for a BiasStrength its extension by a reverting drift and correlated noise.

    A and Q after dt () s for the state (bias, drift), (12, 12), or (bias, drift, correlated noise), (18, 18).
    """
    if not isinstance(strength, BiasStrength):
        return bias_drift_noise(dt, strength)
    rows: tuple[Rows, Rows] = reverting_drift(dt, strength)
    if strength.noise_rate is not None and strength.noise_variance is not None:
        forgotten = -jnp.expm1(-strength.noise_rate * dt)
        variance = strength.noise_variance * forgotten * (2 - forgotten)
        rows = (_append(rows[0], 1 - forgotten), _append(rows[1], variance))
    return _by_axis(rows[0]), _by_axis(rows[1])


def _append(rows: Rows, last: Array) -> Rows:
    """A matrix extended block-diagonally by one entry."""
    return [*([*row, 0] for row in rows), [*([0] * len(rows)), last]]


def _by_axis(rows: Rows) -> Array:
    """Entries over axes -> one matrix, in which each entry is a diagonal block over the axes."""
    return jnp.block([[jnp.diag(entry) for entry in row] for row in as_arrays(rows)])


def matrix(rows: Rows) -> Float[Array, "k k"]:
    """Stack rows of scalar entries into a matrix (k, k)."""
    return jnp.stack([jnp.stack(row) for row in as_arrays(rows)])


def as_arrays(rows: Rows) -> list[list[Array]]:
    """Every entry as an array (...,) of the common shape and precision, in its own unit."""
    arrays = [entry for row in rows for entry in row if not isinstance(entry, int)]
    shape, dtype = jnp.broadcast_shapes(*(x.shape for x in arrays)), jnp.result_type(*arrays)
    return [[jnp.broadcast_to(jnp.asarray(entry, dtype), shape) for entry in row] for row in rows]
