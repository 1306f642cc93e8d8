"""What the method gives of a log: its states, and what was learned on the way."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from ftbias_jax.filtering.noise.fit_noise import Noise
from ftbias_jax.types import Array

if TYPE_CHECKING:
    from jaxtyping import Bool, Float


class States(NamedTuple):
    """A log at every sample; the joints given past and future (as stated: past alone), the bias given the past."""

    q: Float[Array, "T n"]
    """rad (m)."""
    dq: Float[Array, "T n"]
    """rad/s."""
    ddq: Float[Array, "T n"]
    """rad/s^2."""
    ddq_std: Float[Array, "T n"]
    """rad/s^2."""
    bias: Float[Array, "T 6"]
    """N, Nm; the corrected wrench is the reading plus this."""
    drift: Float[Array, "T 6"]
    """N/s, Nm/s."""
    bias_std: Float[Array, "T 6"]
    """N, Nm."""
    drift_std: Float[Array, "T 6"]
    """N/s, Nm/s."""
    slow_error: Float[Array, "T 6"]
    """N, Nm: of wrench_tool - reading what is correlated noise, not bias."""
    bias_smooth: Float[Array, "T 2 6"] | None = None
    """N, Nm and per s: bias and drift given past and future; None = not asked for."""
    bias_smooth_std: Float[Array, "T 2 6"] | None = None
    """Its standard deviation."""


class Infos(NamedTuple):
    """What the method learned at every sample and of the log."""

    wrench_tool: Float[Array, "T 6"]
    """N, Nm, sensor frame: what the tool causes."""
    wrench_unbiased: Float[Array, "T 6"]
    """N, Nm: the reading plus the bias; NaN = not measured."""
    innovation: Float[Array, "T 6"]
    """N, Nm; NaN = not used."""
    innovation_std: Float[Array, "T 6"]
    """N, Nm."""
    nis: Float[Array, " T"]
    """Normalised innovation squared, summed over the axes that were used."""
    used: Bool[Array, " T"]
    """Whether the sample passed the gate, and nothing touched the tool."""
    reading_std: Float[Array, "T 6"]
    """N, Nm: how far a reading is off wrench_tool - bias by all its noise."""
    log_likelihood: Float[Array, ""]
    """nats, of joints and wrench."""
    noise: Noise | None
    """What the log shows of its noise; None = the method was not to look, or the log is too short."""
    kept_out: Float[Array, ""]
    """Share of the free samples that the gate keeps out."""
