"""The result of filtering a log."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float

from ftbias_jax.types import Array


@dataclass(frozen=True, eq=False)
class Filtered:
    """Result of filtering a log, at the stamps where any wrench axis was measured. Signs as in the report.

    NumPy arrays; the fields are those of the output file, with the same names. Wrenches are in the sensor frame and act
    on the tool: unbiased = measured + bias. Effects that the setup states are in wrench_tool, those of the bias
    (warming up, temperature) in bias.
    """

    t: Float[Array, " T"]
    """s, as recorded."""
    bias: Float[Array, "T 6"]
    """N, Nm."""
    drift: Float[Array, "T 6"]
    """N/s, Nm/s, the bias's rate of change."""
    bias_std: Float[Array, "T 6"]
    """N, Nm, standard deviation."""
    drift_std: Float[Array, "T 6"]
    """N/s, Nm/s, standard deviation."""
    wrench_unbiased: Float[Array, "T 6"]
    """N, Nm, measured + bias; NaN = not measured."""
    q: Float[Array, "T n"]
    """rad (m for prismatic joints), filtered joint positions."""
    dq: Float[Array, "T n"]
    """rad/s (m/s)."""
    ddq: Float[Array, "T n"]
    """rad/s^2 (m/s^2)."""
    ddq_std: Float[Array, "T n"]
    """rad/s^2 (m/s^2), standard deviation."""
    wrench_tool: Float[Array, "T 6"]
    """N, Nm, wrench that the tool must cause by its weight and motion."""
    innovation: Float[Array, "T 6"]
    """N, Nm, wrench_tool minus the reading corrected by the predicted bias; NaN = not used."""
    nis: Float[Array, " T"]
    """Normalised innovation squared, summed over the axes that were used."""
    log_likelihood: Float[Array, ""]
    """nats, of joints and wrench together."""
    innovation_std: Float[Array, "T 6"]
    """N, Nm, standard deviation of the innovation, with the sample noise that the log shows."""
    used: Bool[Array, " T"] | None = None
    """Whether the sample passed the gate and nothing touched the tool."""
    reading_std: Float[Array, "T 6"] | None = None
    """N, Nm: standard deviation of a reading about wrench_tool - bias from all its noise, white and correlated. With
    bias_std it determines how well a later reading can be predicted."""
    slow_error: Float[Array, "T 6"] | None = None
    """N, Nm: the part of wrench_tool - reading that is correlated noise, not bias; None if filtered as stated."""
    contact_wrench: Float[Array, "T 6"] | None = None
    """N, Nm: wrench of the environment on the tool, wrench_tool - wrench_unbiased; None if filtered as stated."""
    contact_wrench_std: Float[Array, "T 6"] | None = None
    """N, Nm, standard deviation of contact_wrench, from bias and reading together."""
    in_contact: Bool[Array, " T"] | None = None
    """Whether the sample is in an interval in which something touches the tool, found from the whole log."""
    bias_smooth: Float[Array, "T 6"] | None = None
    """N, Nm, bias given the whole log, past and future; None if not asked for."""
    drift_smooth: Float[Array, "T 6"] | None = None
    """N/s, Nm/s."""
    bias_smooth_std: Float[Array, "T 6"] | None = None
    """N, Nm, standard deviation."""
    drift_smooth_std: Float[Array, "T 6"] | None = None
    """N/s, Nm/s, standard deviation."""


ARRAYS = tuple(field.name for field in fields(Filtered))
"""Names of the arrays as in a file, t first."""


def join(parts: Sequence[Filtered]) -> Filtered:
    """The results of consecutive parts as one."""
    if len(parts) == 1:
        return parts[0]
    named = {name: [getattr(part, name) for part in parts] for name in named_arrays(parts[0])}
    joined = {name: np.concatenate(x) for name, x in named.items() if name != "log_likelihood"}
    return Filtered(**joined, log_likelihood=np.sum(named["log_likelihood"]))


def named_arrays(filtered: Filtered) -> dict[str, Array]:
    """The arrays (T, ...) that are not None, by their names in a file: s, rad, N, Nm."""
    return {name: x for name in ARRAYS if (x := getattr(filtered, name)) is not None}
