"""Data of a log between the passes of the method, and the output of the method: its states and its infos."""

from typing import Any, NamedTuple

from jaxtyping import Bool, Float

from ftbias_jax.filtering.noise.blocks import Blocks, Layout
from ftbias_jax.filtering.noise.fit_noise import Noise
from ftbias_jax.filtering.step import Options, State
from ftbias_jax.model.kinematics.recorded_pose import speeds_of
from ftbias_jax.model.params import Params
from ftbias_jax.types import Array, Sample

LATER: Any = None
"""Placeholder of a field until a pass has found its value."""


class Joints(NamedTuple):
    """Position, velocity and acceleration of the joints at every sample, and what follows from them."""

    mean: tuple[Float[Array, "T n"], Float[Array, "T n"], Float[Array, "T n"]]
    """rad, rad/s, rad/s^2."""
    ddq_std: Float[Array, "T n"]
    """rad/s^2."""
    wrench_tool: Float[Array, "T 6"]
    """N, Nm; with the known effects, if there are any."""
    variance: Float[Array, "T 6"]
    """N^2, Nm^2, diagonal of R as the setup states it."""
    known_bias: Float[Array, "T 6"]
    """N, Nm, what known effects add to the bias."""
    log_likelihood: Float[Array, ""]
    """nats of the joints' measurements."""


class States(NamedTuple):
    """States of a log at every sample; joints given past and future (as stated: past alone), bias given the past.

    Names, signs and units are those of ``result.Filtered``.
    """

    q: Float[Array, "T n"]
    dq: Float[Array, "T n"]
    ddq: Float[Array, "T n"]
    ddq_std: Float[Array, "T n"]
    bias: Float[Array, "T 6"]
    drift: Float[Array, "T 6"]
    bias_std: Float[Array, "T 6"]
    drift_std: Float[Array, "T 6"]
    slow_error: Float[Array, "T 6"]
    bias_smooth: Float[Array, "T 2 6"] | None = None
    """N, Nm and per s: bias and drift given past and future; None = not asked for."""
    bias_smooth_std: Float[Array, "T 2 6"] | None = None
    """Standard deviation of ``bias_smooth``."""


class Work(NamedTuple):
    """What is known of a log so far; every pass of the method adds to it."""

    params: Params
    start: State
    """State before the first sample; its bias is None where it begins with the prior."""
    samples: Sample
    t: Float[Array, " T"]
    """s, since the log began."""
    length: Array
    """Number of samples at the start that count; after them comes padding, or the beginning of the next part."""
    layout: Layout
    options: Options
    seen: Array | None = None
    """Number of samples that are not padding, some of which may be of the next part; None = those that count."""
    joints: Joints = LATER
    stated: Params | None = None
    """Parameters before the log's noise was added to them."""
    noise: Noise | None = None
    blocks: Blocks = LATER
    touched: Bool[Array, " T"] | None = None
    """Whether each sample is in contact or near it, and so left out."""
    states: States = LATER
    """States from the filter of the bias."""
    innovation: Float[Array, "T 6"] = LATER
    """N, Nm; NaN = not used."""
    predicted: Float[Array, "T 6"] = LATER
    """N^2, Nm^2, variance of the innovation without the noise of the sample itself."""
    log_likelihood: Float[Array, ""] = LATER
    """nats, log-likelihood of the wrench."""
    end: State = LATER
    """State after the last sample that counts."""

    @property
    def speeds(self) -> Float[Array, "T s"]:
        """Speeds, rad/s, with which noise may grow."""
        return speeds_of(self.params.arm, self.joints.mean[1])


class Infos(NamedTuple):
    """Results at every sample and of the log beside its states; names, signs and units as in ``result.Filtered``."""

    wrench_tool: Float[Array, "T 6"]
    wrench_unbiased: Float[Array, "T 6"]
    innovation: Float[Array, "T 6"]
    innovation_std: Float[Array, "T 6"]
    nis: Float[Array, " T"]
    used: Bool[Array, " T"]
    reading_std: Float[Array, "T 6"]
    log_likelihood: Float[Array, ""]
    noise: Noise | None
    """Noise that the log shows; None = the method does not look for it, or the log is too short."""
    kept_out: Float[Array, ""]
    """Share of the free samples that the gate rejects."""
    kept_out_at_first: Float[Array, ""]
    """Share of the free samples in the first second of these that the gate rejects."""
