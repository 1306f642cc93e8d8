"""What an entry of the catalogue says about its fit: its coordinates, and which of a few searches finds it.

A diagnosis reads only this; no effect is known to it by name. Searches speak of an effect's parameters by role, so an
entry says which of its parameters plays which.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

from ftbias_jax.types import Array

LINEAR, LOGARITHM, INVERSE = "linear", "logarithm", "inverse"


class Coordinate(NamedTuple):
    """How a fit moves a parameter, where that does not follow from its neutral value, its scale and its bounds."""

    transformation: str = LINEAR
    """``linear``: zero + scale z; ``logarithm``: zero exp(z); ``inverse``: scale / z."""
    scale: float | Array | None = None
    """Typical departure, in the parameter's unit; None = the parameter's scale."""
    zero: float | None = None
    """Value at coordinate 0; None = the neutral one."""
    lower: float | None = None
    """Least value that is plausible; None = the parameter's bound."""
    upper: float | None = None


class Linear(NamedTuple):
    """Smooth at zero: one linearisation at neutral tells all about it."""

    variants: tuple[tuple[tuple[str, float], ...], ...] = ((),)
    """(parameter, value) pairs that are held; each variant is a hypothesis."""


class ByJoint(NamedTuple):
    """Smooth at zero, an offset of one joint: each joint is a hypothesis.

    The effect must take arrays (n,) of joints and offsets, too, and do nothing but move joints: how the arm then moves
    is worked out once and not with every reading.
    """

    number: str
    """Parameter that says which joint, from 1."""
    offset: str


class Entries(NamedTuple):
    """Smooth at zero, a matrix (6, 6) a few of whose entries are found; then all of it is told, as its posterior."""

    matrix: str


class Grid(NamedTuple):
    """Fits from several starts: all combinations of ``Parameter.starts``."""

    per_load: bool = False
    """The starts are shares of the load's range, channel by channel, and channels are ranked one by one."""


class Settling(NamedTuple):
    """A slow series, linear in its strength: its time constant is searched among ``Parameter.starts`` and refined."""

    time: str
    """Parameter, s; where 0 is among its starts, the series without a lag is not refined."""
    longest: float
    """Share of the log's length that the time constant may be; a longer one is no different from a straight line."""
    shortest: float = 0.0
    """The same; a shorter one is over before it is seen."""
    by_log: bool = False
    """Each log may have one of its own, too."""
    least_range: float = 0.0
    """Of the series; one that moves less says nothing."""


class Step(NamedTuple):
    """A series that begins at some time and stays, suddenly or along a ramp, linear in its strength."""

    time: str
    ramp: str


class Touches(NamedTuple):
    """Events of any shape in time, each with a wrench of its own; they tell the force at their peak, in base axes."""

    start: str
    end: str
    force: str


class Pull(NamedTuple):
    """An elastic pull of the tool towards a point of a link or of the world: anchors at random, the best are fitted."""

    span: Callable[[dict[str, Array], Any], Array]
    """(values, signals) -> (T, 3) m, sensor frame, from the near to the far end; affine in the anchor."""
    stiffness: str = "stiffness"
    rest_length: str = "rest_length"
    anchor: str = "anchor"
    link: str = "link"
    attachment: str = "attachment"


class Ringing(NamedTuple):
    """A tool that swings at one frequency: in the usual way, or in those of six ways that matter."""

    frequency: str = "frequency"
    damping_ratio: str = "damping_ratio"
    share: str = "share"
    sagging: str = "sagging"


class Starts(NamedTuple):
    """By what the parameters say of themselves: strengths linearised at each combination of the others' starts.

    A searched time that may be 0 and may be as late as the end of the log is tried all along it.
    """


class Samples(NamedTuple):
    """Read off single samples, before anything is averaged."""

    sign: str
    """What they show: one of ``SIGNS``."""
    first: bool = False
    """Told before what explains the mean reading, because that may be its consequence."""


LEVEL, SPIKES, LATTICE, FLAT_TOPS = "level", "spikes", "lattice", "flat_tops"
LOST, JITTER, GROWTH = "lost", "jitter", "growth"
SIGNS = (LEVEL, SPIKES, LATTICE, FLAT_TOPS, LOST, JITTER, GROWTH)
"""The size of the white noise; samples far off; multiples of a step; one extreme value; lost or repeated samples;
scatter along the rate of the wrench; noise that grows with the speed of the joints."""

Search: TypeAlias = Linear | ByJoint | Entries | Grid | Settling | Step | Touches | Pull | Ringing | Starts | Samples
SMOOTH = (Linear, ByJoint, Entries)
"""Searches of effects that the derivative at zero strength tells all about."""
BY_COORDINATES = (*SMOOTH, Grid, Pull, Ringing, Starts)
"""Searches of effects that are fitted in coordinates, within the model of the mean reading."""
SUDDEN = (Step, Touches)
"""Searches of effects that gain in few blocks of a log."""


class Fitting(NamedTuple):
    """How an effect is found and judged."""

    search: Search = Starts()
    form_error: float | None = None
    """Share of a parameter's departure from neutral that a real effect's form may put into it; None = as of most."""
    credit: float = 1.0
    """Share of its gain that counts when effects are ranked: under 1, if a structured explanation that is nearly as
    good comes first."""
    extends: str = ""
    """Effect that it is a more general form of: it must earn what it has more, or that one stands for both."""
    any_shape: bool = False
    """It can take nearly any shape, so that terms compete with it even where it explains a log."""
    told: Callable[[dict[str, Array], Any], dict[str, Array]] | None = None
    """(values, model) -> values that say the same in the usual form."""
    possible: Callable[[dict[str, Any], dict[str, Any]], bool] | None = None
    """(values, standard errors) -> whether anything that exists may have them; None = there always may."""
    unmeasured: Callable[[Any], bool] | None = None
    """Setup -> whether a drafted one leaves open what this changes; None = a draft has it from the log, or knows it."""
