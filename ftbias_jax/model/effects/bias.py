"""Effects of the bias stage: biases that are not linear in time.

Signs are the report's: amplitudes add to the bias b, and the reading is D theta - b, so a positive one lowers it.
"""

import jax.numpy as jnp
import numpy as np

from ftbias_jax.model.effects.fitting import Fitting, Settling, Step
from ftbias_jax.model.effects.responses import lagged
from ftbias_jax.model.effects.statements import channels
from ftbias_jax.model.effects.types import Effect, EffectValues, Parameter, Signals, Twin, within
from ftbias_jax.types import Array

_NEWTON = np.array([1.0] * 3 + [0.1] * 3)
_TIMES = tuple(np.geomspace(0.5, 512.0, 21).tolist())
"""s: initial time constants of a search; the series of neighbouring ones have a correlation above 0.99."""


def warmup(values: EffectValues, signals: Signals, wrench: Array) -> Array:
    """b + amplitude (1 - exp(-t / tau)), t from the start of the log."""
    xp = signals.t.__array_namespace__()
    return wrench + xp.expm1(-signals.t / values["tau"])[:, None] * values["amplitude"][None]


def temperature_drift(values: EffectValues, signals: Signals, wrench: Array) -> Array:
    """b + per_kelvin (temperature - its first value), after a first-order lag if the gauges lag the thermometer."""
    lag = values["lag"]
    cutoff = jnp.where(lag > 0, 1 / (2 * jnp.pi * jnp.where(lag > 0, lag, 1)), jnp.inf)
    felt = lagged(signals.t, signals.temperature[:, None], cutoff)[:, 0]
    warmer = felt - felt[0]
    return wrench - warmer[:, None] * values["per_kelvin"][None]


def bias_jump(values: EffectValues, signals: Signals, wrench: Array) -> Array:
    """b + amplitude from the stated time on, or reached along a linear ramp that begins there."""
    after, ramp, xp = signals.t - values["time"], values["ramp"], signals.t.__array_namespace__()
    rising = xp.clip(after / xp.where(ramp > 0, ramp, 1), 0, 1)
    return wrench - xp.where(ramp > 0, rising, xp.where(after >= 0, 1, 0))[:, None] * values["amplitude"][None]


EFFECTS = (
    Effect(
        "warmup",
        "bias",
        (
            Parameter("amplitude", "N, Nm", "bias gained in the end", (6,), -1e4, 1e4, 0.0, _NEWTON),
            Parameter("tau", "s", "time constant", (), 1e-2, 1e6, 60.0, 60.0, search=True, starts=_TIMES),
        ),
        "the bias settles exponentially after the sensor was switched on",
        "let the sensor warm up before recording, or keep this correction",
        reading=warmup,
        # A second, longer time constant mimics drift.
        fit=Fitting(Settling("tau", 2.0, 0.02, by_log=True), form_error=0.12, any_shape=True),
        twins=(
            Twin("none", False, "with tau longer than the log it is a straight drift: record longer"),
            Twin("temperature_drift", False, "record the temperature, and a log that starts warm"),
        ),
        statement=channels("the bias of {channel} settles by {value}, time constant {tau:.3g} s", "amplitude"),
    ),
    Effect(
        "temperature_drift",
        "bias",
        (
            Parameter("per_kelvin", "N/K, Nm/K", "bias gained per degree", (6,), -1e3, 1e3, 0.0, 0.05 * _NEWTON),
            Parameter(
                "lag",
                "s",
                "time constant with which the gauges follow the recorded temperature",
                **within((), 0.0, 1e6, 0.0, 5.0, search=True, optional=True, starts=(0.0, *_TIMES)),
            ),
        ),
        "the bias follows the sensor's temperature",
        "record the temperature and keep this correction, or hold it constant",
        reading=temperature_drift,
        # Gauges are not linear in temperature; a thermometer's own noise is up to 0.3 K.
        fit=Fitting(Settling("lag", 0.5, least_range=0.3), form_error=0.1),
        twins=(Twin("warmup", True, "the same when the temperature rises exponentially: cool down or start warm"),),
        needs=("temperature",),
        statement=channels(
            "the bias of {channel} follows the temperature by {value}", "per_kelvin", unit="{unit} per K"
        ),
    ),
    Effect(
        "bias_jump",
        "bias",
        (
            Parameter("time", "s", "when, from the start of the log", (), 0.0, 1e7, 0.0, 5.0, search=True),
            Parameter("amplitude", "N, Nm", "bias gained", (6,), -1e4, 1e4, 0.0, _NEWTON),
            Parameter(
                "ramp", "s", "how long the jump takes; 0 = no time", (), 0.0, 1e6, 0.0, 0.5, search=True, optional=True
            ),
        ),
        "the bias jumped once and stayed",
        "look for a re-tare, an overload or a tool change at that time",
        reading=bias_jump,
        fit=Fitting(Step("time", "ramp"), form_error=0.05, any_shape=True),  # A real jump settles.
        twins=(Twin("contact", False, "a contact ends; watch the wrench for longer"),),
        statement=channels("the bias of {channel} jumped by {value} at {time:.4g} s", "amplitude"),
    ),
)
