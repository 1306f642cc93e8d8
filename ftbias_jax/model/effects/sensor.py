"""Effects of the sensor stage that change its mean reading: gain, crosstalk, hysteresis, lag and delay."""

import jax.numpy as jnp
import numpy as np

from ftbias_jax.model.effects.fitting import INVERSE, Coordinate, Entries, Fitting, Grid, Linear
from ftbias_jax.model.effects.responses import FIRST, SECOND, delayed, lagged, played
from ftbias_jax.model.effects.statements import PERCENT, amount, channels, leak
from ftbias_jax.model.effects.types import Effect, EffectValues, Parameter, Signals, Twin, within
from ftbias_jax.types import Array

_OFF_DIAGONAL = 1 - np.eye(6)
# Force read per torque (N/Nm) is large and torque read per force (Nm/N) small: a lever of 0.1 m relates the two.
_LEVER = np.where(np.arange(6) < 3, 1.0, 0.1)
_LEAK = _LEVER[:, None] / _LEVER[None, :]

_DELAYS = (0.0, 0.05, 0.12, 0.25, 0.45)
"""s; initial delays of a search, because drivers report up to half a second."""
_RATES, _OFFSETS = (-4000.0, -1500.0, -500.0, 500.0, 1500.0, 4000.0), (0.0, 0.12, 0.3)
"""Initial values of a search: ppm; and s at the start of the log, chosen as for delays."""
_CUTOFFS = tuple(1 / (2 * np.pi * lag) for lag in (0.008, 0.02, 0.04, 0.08, 0.16, 0.32))
"""Hz; initial cutoffs of a search, of filters with these time constants, s."""
_PASSED = Coordinate(INVERSE, upper=1.6e3)
"""Hz; a filter with the upper cutoff has no effect on a log in bins."""
_ENTRY = 10 * _OFF_DIAGONAL * _LEAK
"""Largest crosstalk between two channels."""
_LOOPS = (0.01, 0.03, 0.08, 0.2)
"""Initial widths of hysteresis loops as shares of the load's range."""


def gain(values: EffectValues, signals: Signals, wrench: Array) -> Array:
    """Every channel reads a multiple of its load."""
    return values["gain"][None] * wrench


def crosstalk(values: EffectValues, signals: Signals, wrench: Array) -> Array:
    """A channel reads a part of the others: reading = M W, with ones as the diagonal of M, which ``gain`` describes."""
    matrix = values["matrix"]
    leak = matrix * _OFF_DIAGONAL.astype(matrix.dtype)
    return wrench + wrench @ leak.T


def hysteresis(values: EffectValues, signals: Signals, wrench: Array) -> Array:
    """Backlash of each channel (play operator): the reading depends on the direction of the load change."""
    return played(wrench, values["width"])


def low_pass(values: EffectValues, signals: Signals, wrench: Array) -> Array:
    """Low-pass of every channel, first-order or second-order Butterworth."""
    return lagged(signals.t, wrench, values["cutoff"], values["order"])


def time_delay(values: EffectValues, signals: Signals, wrench: Array) -> Array:
    """The sample with stamp t has the wrench of t - delay."""
    return delayed(signals.t, wrench, values["delay"])


def clock_drift(values: EffectValues, signals: Signals, wrench: Array) -> Array:
    """The wrench's clock runs fast by ``rate`` ppm, so the wrench is older than its stamp by an age that grows."""
    return delayed(signals.t, wrench, values["offset"] + 1e-6 * values["rate"] * signals.t)


EFFECTS = (
    Effect(
        "gain",
        "sensor",
        (Parameter("gain", "1", "reading per load, channel by channel", (6,), 0.01, 100.0, 1.0, 0.02),),
        "the sensor's channels read a few per cent too much or too little",
        "have the sensor recalibrated, or keep this correction",
        reading=gain,
        fit=Fitting(Linear(), by_load=True),
        twins=(
            Twin("tool_mass", True, "equal gains are a scaling of the whole tool: hang a known weight on it"),
            Twin("tool_com", False, "hang a known weight at a known lever"),
        ),
        statement=channels("{channel} {verb} {value} too {sign} of the load", "gain", 1.0, "%", PERCENT),
    ),
    Effect(
        "crosstalk",
        "sensor",
        (
            Parameter(
                "matrix",
                "1, N/Nm, Nm/N",
                "reading per load, row by column, with ones on the diagonal",
                **within((6, 6), np.eye(6) - _ENTRY, np.eye(6) + _ENTRY, np.eye(6), 0.02 * _OFF_DIAGONAL * _LEAK),
            ),
        ),
        "one channel of the sensor leaks into another",
        "have the sensor recalibrated, or keep this correction",
        reading=crosstalk,
        fit=Fitting(Entries("matrix"), credit=0.95, any_shape=True),
        twins=(
            Twin("tool_com", False, "load single axes by hand"),
            Twin("mount_rotation", False, "load single axes by hand: a rotation mixes force with force only"),
        ),
        statement=leak("{value} of {source} leaks into {target}", "matrix"),
    ),
    Effect(
        "hysteresis",
        "sensor",
        (
            Parameter(
                "width",
                "N, Nm",
                "width of the loop, channel by channel",
                **within((6,), 0.0, 1e4, 0.0, [0.1] * 3 + [5e-3] * 3, starts=_LOOPS),
            ),
        ),
        "the reading depends on whether the load rises or falls",
        "check the mounting bolts; otherwise it is the sensor's hysteresis class",
        reading=hysteresis,
        fit=Fitting(Grid(per_load=True), any_shape=True),
        twins=(Twin("low_pass", False, "repeat a motion at another speed: hysteresis does not depend on it"),),
        statement=channels("the reading of {channel} runs in a loop {value} wide (hysteresis)", "width"),
    ),
    Effect(
        "low_pass",
        "sensor",
        (
            Parameter(
                "cutoff",
                "Hz",
                "frequency where the gain is 1/sqrt(2)",
                **within((), 0.01, np.inf, np.inf, 10.0, search=True, starts=_CUTOFFS, coordinate=_PASSED),
            ),
            Parameter(
                "order",
                "1",
                "1, or 2 for a Butterworth filter",
                **within((), FIRST, SECOND, FIRST, 0.0, search=True, optional=True, starts=(FIRST, SECOND)),
            ),
        ),
        "the wrench is smoothed by a filter in sensor or driver, or the log has commanded joints, which lead the arm's",
        "raise the cutoff or switch the filter off in the sensor's settings, and log measured joints",
        reading=low_pass,
        forgets=lambda values: 1 / (2 * jnp.pi * values["cutoff"]),
        # Filters of another order, or a moving average, with the same delay have other cutoffs.
        fit=Fitting(Grid(), form_error=0.15),
        twins=(Twin("time_delay", False, "move fast: a low-pass attenuates, a delay does not"),),
        statement=amount("a low-pass of {value} Hz smooths the wrench", "cutoff"),
    ),
)

DELAY = (
    Effect(
        "time_delay",
        "sensor",
        (
            Parameter(
                "delay",
                "s",
                "age of the wrench at its stamp; negative = the joints are late",
                **within((), -1, 2, 0, 0.01, starts=_DELAYS),
            ),
        ),
        "wrench and joint states are not stamped at the same time, or commanded joints, which lead, were logged",
        "use the hardware's stamps or shift the stamps of one stream",
        reading=time_delay,
        fit=Fitting(Grid()),
        twins=(
            Twin("low_pass", False, "move fast: a low-pass attenuates, a delay does not"),
            Twin("tool_flexibility", False, "accelerate sharply: a flexible tool rings"),
        ),
        statement=amount("the wrench is {value} ms {sign} against the joints", "delay", 1e3, ("late", "early")),
    ),
    Effect(
        "clock_drift",
        "timing",
        (
            Parameter(
                "rate",
                "ppm",
                "how fast the clock of the wrench's stamps runs against that of the joints'",
                **within((), -2e4, 2e4, 0, 500.0, starts=_RATES),
            ),
            Parameter(
                "offset",
                "s",
                "age of the wrench at its stamp when the log begins; negative = the joints are late",
                **within((), -1, 2, 0, 0.01, optional=True, starts=_OFFSETS),
            ),
        ),
        "the clocks that stamp wrench and joint states run at different rates",
        "stamp both streams with one clock, or state wrench_rate in [log.clocks]",
        reading=clock_drift,
        fit=Fitting(Grid(), form_error=0.005, extends="time_delay"),
        twins=(Twin("time_delay", False, "record for longer: this delay grows"),),
        statement=amount(
            "the wrench's clock runs {value} ppm {sign} against the joints'", "rate", 1.0, ("fast", "slow")
        ),
    ),
)
"""Acts on everything the sensor measures."""
