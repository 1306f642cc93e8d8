"""The result of filtering a log."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftbias_jax.types import Array

if TYPE_CHECKING:
    from jaxtyping import Bool, Float


class Filtered(NamedTuple):
    """Result of filtering a log, at the stamps where any wrench axis was measured. Signs as in the report.

    numpy arrays with leading axis T; the fields are those of the output file, with the same names. Effects that the
    setup knows of are in wrench_tool, those of the bias (warming up, temperature) in bias.
    """

    t: Float[Array, " T"]
    bias: Float[Array, "T 6"]
    drift: Float[Array, "T 6"]
    bias_std: Float[Array, "T 6"]
    drift_std: Float[Array, "T 6"]
    wrench_unbiased: Float[Array, "T 6"]
    q: Float[Array, "T n"]
    dq: Float[Array, "T n"]
    ddq: Float[Array, "T n"]
    ddq_std: Float[Array, "T n"]
    wrench_tool: Float[Array, "T 6"]
    innovation: Float[Array, "T 6"]
    nis: Float[Array, " T"]
    log_likelihood: Float[Array, ""]
    innovation_std: Float[Array, "T 6"]
    used: Bool[Array, " T"] | None = None
    """Whether the sample passed the gate, and nothing touched the tool."""
    reading_std: Float[Array, "T 6"] | None = None
    """N, Nm: how far a reading is off wrench_tool - bias by all its noise, white and correlated. With bias_std it tells
    how well a later reading can be predicted."""
    slow_error: Float[Array, "T 6"] | None = None
    """N, Nm: of wrench_tool - reading what is correlated noise, not bias."""
    contact_wrench: Float[Array, "T 6"] | None = None
    """N, Nm, sensor frame: what the environment exerts on the tool, wrench_tool - wrench_unbiased."""
    contact_wrench_std: Float[Array, "T 6"] | None = None
    """N, Nm: its standard deviation, of bias and reading together."""
    in_contact: Bool[Array, " T"] | None = None
    """Whether the sample is in an interval in which something touches the tool, found in the whole log."""


def join(parts: Sequence[Filtered]) -> Filtered:
    """The results of consecutive parts as one."""

    def joined(values: Sequence[Array | None]) -> Array | None:
        present = [x for x in values if x is not None]
        if not present:
            return None
        return present[0] if present[0].ndim == 0 else np.concatenate(present)

    if len(parts) == 1:
        return parts[0]
    whole = Filtered(*(joined(x) for x in zip(*parts, strict=True)))
    return whole._replace(log_likelihood=np.sum([part.log_likelihood for part in parts]))


def named_arrays(filtered: Filtered) -> dict[str, Array]:
    """The arrays (T, ...) that there are, as they stand in a file: s, rad, N, Nm."""
    return {name: x for name, x in filtered._asdict().items() if x is not None}
