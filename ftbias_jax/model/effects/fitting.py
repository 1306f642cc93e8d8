"""Description of how a catalogue entry is fitted: its coordinates, and which of a few searches finds it.

A diagnosis reads only this description and knows no effect by name. Searches refer to an effect's parameters by role,
so an entry states which of its parameters has which role.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

from ftbias_jax.types import Array

LINEAR, LOGARITHM, INVERSE = "linear", "logarithm", "inverse"


class Coordinate(NamedTuple):
    """Coordinate in which a parameter is fitted, where its neutral value, scale and bounds do not define it."""

    transformation: str = LINEAR
    """``linear``: zero + scale z; ``logarithm``: zero exp(z); ``inverse``: scale / z."""
    scale: float | Array | None = None
    """Typical departure, in the parameter's unit; None = the parameter's scale."""
    zero: float | None = None
    """Value at coordinate 0; None = the neutral one."""
    lower: float | None = None
    """Smallest plausible value; None = the parameter's bound."""
    upper: float | None = None


class Linear(NamedTuple):
    """Effect that is smooth at zero, so that one linearisation at its neutral values describes it fully."""

    variants: tuple[tuple[tuple[str, float], ...], ...] = ((),)
    """(parameter, value) pairs that are held fixed; each variant is a hypothesis."""


class ByJoint(NamedTuple):
    """Offset of one joint, smooth at zero; each joint is a hypothesis.

    The effect must also accept arrays (n,) of joints and offsets, and do nothing but move joints, because the resulting
    motion of the arm is computed once and not with every reading.
    """

    number: str
    """Parameter that holds the number of the joint, from 1."""
    offset: str


class Entries(NamedTuple):
    """Matrix (6, 6), smooth at zero: a few entries are found first, then the posterior of all entries is reported."""

    matrix: str


class Grid(NamedTuple):
    """Fits from multiple starts: all combinations of ``Parameter.starts``."""

    per_load: bool = False
    """Whether the starts are shares of each channel's load range, and channels are ranked separately."""


class Settling(NamedTuple):
    """Slow series, linear in its strength; its time constant is searched among ``Parameter.starts`` and refined."""

    time: str
    """Parameter with the time constant, s; if 0 is among its starts, the series without a lag is not refined."""
    longest: float
    """Longest time constant as a share of the log's length; a longer one is indistinguishable from a straight line."""
    shortest: float = 0.0
    """Shortest time constant as a share of the log's length; a shorter transient ends before it can be observed."""
    by_log: bool = False
    """Whether each log may also have a series of its own."""
    least_range: float = 0.0
    """Minimum range of the series; one that varies less is not informative."""


class Step(NamedTuple):
    """Step at an unknown time, sudden or along a ramp, that persists and is linear in its strength."""

    time: str
    ramp: str


class Touches(NamedTuple):
    """Events of any shape in time, each with its own wrench; their force at the peak, in base axes, is reported."""

    start: str
    end: str
    force: str


class Pull(NamedTuple):
    """Elastic pull of the tool towards a point of a link or the world; of many random anchors the best are fitted."""

    span: Callable[[dict[str, Array], Any], Array]
    """(values, signals) -> (T, 3) m, sensor frame, from the near to the far end; affine in the anchor."""
    stiffness: str = "stiffness"
    rest_length: str = "rest_length"
    anchor: str = "anchor"
    link: str = "link"
    attachment: str = "attachment"


class Ringing(NamedTuple):
    """Tool that oscillates at one frequency, in the modes that are neutral or in those of six modes that matter."""

    frequency: str = "frequency"
    damping_ratio: str = "damping_ratio"
    share: str = "share"
    sagging: str = "sagging"


class Starts(NamedTuple):
    """Generic search defined by the parameters: strengths are linearised at each combination of the others' starts.

    A searched time whose bounds include 0 and the end of the log is tried all along the log.
    """


class Samples(NamedTuple):
    """Effect that is found in single samples, before anything is averaged."""

    sign: str
    """Signature that the samples show: one of ``SIGNS``."""
    first: bool = False
    """Whether it is reported before effects on the mean reading, because these may be its consequence."""


LEVEL, SPIKES, LATTICE, FLAT_TOPS = "level", "spikes", "lattice", "flat_tops"
LOST, JITTER, GROWTH = "lost", "jitter", "growth"
SIGNS = (LEVEL, SPIKES, LATTICE, FLAT_TOPS, LOST, JITTER, GROWTH)
"""Signatures, in this order: level of the white noise; outliers; multiples of a step; one extreme value; lost or
repeated samples; scatter in proportion to the rate of the wrench; noise that grows with the speed of the joints."""

Search: TypeAlias = Linear | ByJoint | Entries | Grid | Settling | Step | Touches | Pull | Ringing | Starts | Samples
SMOOTH = (Linear, ByJoint, Entries)
"""Searches of effects that their derivative at zero strength describes fully."""
BY_COORDINATES = (*SMOOTH, Grid, Pull, Ringing, Starts)
"""Searches of effects that are fitted in coordinates, within the model of the mean reading."""
SUDDEN = (Step, Touches)
"""Searches of effects whose gain in log-likelihood comes from few blocks of a log."""


class Fitting(NamedTuple):
    """How an effect is found and judged."""

    search: Search = Starts()
    form_error: float | None = None
    """Relative error of a parameter's departure from neutral because a real effect has another form; None = default."""
    credit: float = 1.0
    """Share of its gain that counts when effects are ranked: below 1 if a more structured explanation that is nearly as
    good is preferred."""
    extends: str = ""
    """Effect that this one generalises; that one is kept unless the further parameters of this one are worth it."""
    any_shape: bool = False
    """Whether it can take nearly any shape, so that terms compete with it even where it explains a log."""
    by_load: bool = False
    """Whether it scales the load of each channel, as a gauge that is not linear nearly does."""
    told: Callable[[dict[str, Array], Any], dict[str, Array]] | None = None
    """(values, model) -> equivalent values in the usual form."""
    possible: Callable[[dict[str, Any], dict[str, Any]], bool] | None = None
    """(values, standard errors) -> whether they are physically possible; None = always."""
    unmeasured: Callable[[Any], bool] | None = None
    """Setup -> whether a draft leaves the changed quantity open; None = a draft has it from the log, or knows it."""
