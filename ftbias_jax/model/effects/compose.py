"""Application of all effects of a log in physical order, whatever order they are named in.

Motion and model -> transforms -> wrench of the tool -> readings -> bias and noise -> recordings.
"""

from collections.abc import Iterator, Mapping

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.model.effects.catalogue import CATALOGUE, catalogue_of, complete
from ftbias_jax.model.effects.terms.columns import change, state_of
from ftbias_jax.model.effects.terms.columns import noise_variance as term_noise
from ftbias_jax.model.effects.terms.forms import FORMS
from ftbias_jax.model.effects.terms.parse import TERM
from ftbias_jax.model.effects.types import Effect, Model, Record, Signals, Values, motion_of
from ftbias_jax.model.wrench.batch import wrenches_in_motion
from ftbias_jax.types import Array

FIRST_KEY = 19
"""Number of the random key of the first effect on samples: a seed gives the same log when other effects are added."""


def predict(signals: Signals, values: Values, catalogue: Mapping[str, Effect] | None = None) -> Array:
    """Noise-free reading with the effects, without the bias process.

    Pure in ``signals`` and ``values``: ``jax.jvp`` with respect to values gives regressors, ``vmap`` maps over either.

    Args:
        signals: motion and nominal model of one log.
        values: effect -> parameters; {} = the nominal model.
        catalogue: name -> effect; None = the catalogue of the values.

    Returns:
        (T, 6) N, Nm, sensor frame, wrench on the tool; biases of effects are subtracted, as in the report.
    """
    signals = transform(signals, values, catalogue)
    signals = signals._replace(motion=motion_of(signals))
    reading = read(signals, values, tool_wrenches(signals), catalogue)
    if TERM not in values:
        return reading
    return reading + change(jnp, values[TERM], state_of(jnp, signals, reading))  # The reading is the terms' load.


def variance_of_terms(signals: Signals, values: Values, reading: Array) -> Array:
    """Noise variance (T, 6) N^2, Nm^2 that the setup's terms add; 0 without any."""
    terms = {name: term for name, term in values.get(TERM, {}).items() if term.acts_as == "noise"}
    return term_noise(jnp, terms, state_of(jnp, signals, reading)) if terms else jnp.zeros_like(reading)


EXTRA_WRENCH = tuple(f"beyond_{axis}" for axis in ("fx", "fy", "fz", "tx", "ty", "tz"))
"""Columns of a log with the wrench, N and Nm, that a user's own simulator adds to that of the nominal tool."""


def tool_wrenches(signals: Signals) -> Array:
    """Wrench of the tool, D theta (T, 6) N, Nm, for the motion and model of ``signals``, plus the columns BEYOND it."""
    wrench = wrenches_in_motion(signals.model.gravity, signals.model.theta, motion_of(signals))
    if EXTRA_WRENCH[0] not in signals.columns:
        return wrench
    return wrench + jnp.stack([signals.columns[name] for name in EXTRA_WRENCH], 1)


def transform(signals: Signals, values: Values, catalogue: Mapping[str, Effect] | None = None) -> Signals:
    """Signals with the actual model and motion, changed from the nominal ones by the ``transform`` of each effect."""
    for name, effect in _acting(values, catalogue):
        if effect.transform:
            moved = effect.transform(complete(effect, values[name], signals.model), signals)
            signals = moved if _moves_alike(moved, signals) else moved._replace(motion=None)
    return signals


def _acting(values: Values, catalogue: Mapping[str, Effect] | None = None) -> Iterator[tuple[str, Effect]]:
    """The effects that have values, in the order in which they act."""
    entries = catalogue_of(values) if catalogue is None else catalogue
    unknown = values.keys() - entries.keys() - {TERM}
    if catalogue is None and unknown:
        raise KeyError(f"no effect {', '.join(sorted(unknown))} in the catalogue of the values")
    yield from ((name, effect) for name, effect in entries.items() if name in values)


def _moves_alike(moved: Signals, signals: Signals) -> bool:
    """Whether the motion is valid after a change: it was replaced as well, or neither joints nor arm changed."""
    before, after = ((s.q, s.dq, s.ddq, s.model.arm) for s in (signals, moved))
    return moved.motion is not signals.motion or all(a is b for a, b in zip(before, after, strict=True))


def read(signals: Signals, values: Values, wrench: Array, catalogue: Mapping[str, Effect] | None = None) -> Array:
    """Reading (T, 6) of the tool's wrench D theta (T, 6) N, Nm with the effects, for signals after ``transform``."""
    for name, effect in _acting(values, catalogue):
        if effect.reading:
            wrench = effect.reading(complete(effect, values[name], signals.model), signals, wrench)
    return wrench


def bias(signals: Signals, values: Values) -> Array:
    """Part of the bias (T, 6) N, Nm that comes from effects of the bias stage, in the report's sign."""
    of_bias = {name: effect for name, effect in _acting(values) if effect.stage == "bias"}
    nothing = jnp.zeros((signals.t.shape[0], 6), signals.q.dtype)
    found: Array = -read(signals, values, nothing, of_bias)
    terms = {name: term for name, term in values.get(TERM, {}).items() if term.acts_as == "bias"}
    return found - change(jnp, terms, state_of(jnp, signals, nothing)) if terms else found


def record(key: Array, recorded: Record, model: Model, values: Values) -> Record:
    """Apply the effects that act on recorded samples; each effect has its own random numbers.

    Args:
        key: JAX key.
        recorded: samples with bias and noise: t (T,) s, wrench (T, 6) N, Nm.
        model: the nominal model that the setup states.
        values: effect -> parameters.
    """
    built_in = [name for name, effect in CATALOGUE.items() if effect.recording]
    own = [name for name in catalogue_of(values) if name not in CATALOGUE]
    numbers = {name: i for i, name in enumerate((*built_in, *own), FIRST_KEY)}
    for name, effect in _acting(values):
        if effect.recording:
            completed = complete(effect, values[name], model)
            recorded = effect.recording(completed, jax.random.fold_in(key, numbers[name]), recorded)
    return recorded


def correct_record(wrench: Array, model: Model, values: Values) -> Array:
    """Recorded wrench (T, 6) N, Nm, NaN where known effects make a sample useless: saturated, spike or repetition."""
    # The order is reversed so that a repetition is recognised before a spike is removed from it.
    for name, effect in reversed(list(_acting(values))):
        if effect.screen:
            wrench = effect.screen(complete(effect, values[name], model), wrench)
    return wrench


def forgetting_time(values: Values, catalogue: Mapping[str, Effect] | None = None) -> float:
    """Longest time constant, s, with which effects and terms forget their initial state; 0 if none has a memory.

    Oscillations and lags are assumed to be settled at the first sample, which need not be true.
    """
    acting = [(effect.forgets, values[name]) for name, effect in _acting(values, catalogue)]
    times = [forgets(jax.tree.map(np.asarray, own)) for forgets, own in acting if forgets]
    for term in values.get(TERM, {}).values():
        if forgets := FORMS[term.drive, term.form].forgets:
            times.append(forgets(term.parameters))
    return max((float(np.nan_to_num(time)) for time in times), default=0.0)  # A rigid undamped tool gives NaN.


def noise_variance(variance: Array, rate: Array, model: Model, values: Values) -> Array:
    """Noise variance of the reading with the known effects that act like noise.

    Args:
        variance: (6,) or (T, 6) N^2, Nm^2, as the setup states it.
        rate: (T, 6) N/s, Nm/s, time derivative of the noise-free reading.
        model: the nominal model that the setup states.
        values: effect -> parameters.

    Returns:
        (T, 6) N^2, Nm^2.
    """
    variance = jnp.broadcast_to(variance, rate.shape)
    for name, effect in _acting(values):
        if effect.widen:
            variance = effect.widen(complete(effect, values[name], model), variance, rate)
    return variance


def fill_temperature(t: Array, temperature: Array) -> Array:
    """Temperature (T,) deg C at t (T,) s with gaps (NaN) filled by linear interpolation; zeros if none is recorded."""
    known = np.isfinite(temperature)
    if not known.any():
        return np.zeros_like(temperature)
    return np.interp(t, t[known], temperature[known]).astype(temperature.dtype)
