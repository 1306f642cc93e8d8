"""All effects of a log together, in physical order, whatever order they are named in.

Motion and model -> transforms -> wrench of the tool -> readings -> bias and noise -> recordings.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.model.effects.catalogue import CATALOGUE, Catalogue, complete
from ftbias_jax.model.effects.kinematics import motion_of
from ftbias_jax.model.effects.terms.columns import change, state_of
from ftbias_jax.model.effects.terms.parse import NAME as TERM
from ftbias_jax.model.effects.types import Model, Record, Signals, Values
from ftbias_jax.model.kinematics.recorded_pose import FreeBody
from ftbias_jax.model.kinematics.screws import Arm
from ftbias_jax.model.wrench.batch import wrenches_in_motion
from ftbias_jax.model.wrench.tool_wrench import tool_wrench
from ftbias_jax.types import Array


def predict(signals: Signals, values: Values, catalogue: Catalogue = CATALOGUE) -> Array:
    """Noise-free reading with the effects, without the bias process.

    Pure in ``signals`` and ``values``: ``jax.jvp`` with respect to values gives regressors, ``vmap`` maps over either.

    Args:
        signals: motion and believed model of one log.
        values: effect -> parameters; {} = the believed model.
        catalogue: the table of effects.

    Returns:
        (T, 6) N, Nm, sensor frame, wrench on the tool; biases of effects are subtracted, as the report's are.
    """
    signals = transform(signals, values, catalogue)
    if not isinstance(signals.model.arm, FreeBody):
        signals = signals._replace(motion=motion_of(signals))
    return with_terms(signals, values, read(signals, values, tool_wrenches(signals), catalogue))


def with_terms(signals: Signals, values: Values, reading: Array) -> Array:
    """The reading (T, 6) N, Nm with what the setup's terms add; their load is the reading before."""
    if TERM not in values:
        return reading
    return reading + change(jnp, values[TERM], state_of(jnp, signals, reading))


def tool_wrenches(signals: Signals) -> Array:
    """(T, 6) N, Nm: wrench of the tool, D theta, for the motion and model of ``signals``."""
    carrier: Arm | FreeBody = signals.model.arm
    if isinstance(carrier, FreeBody):
        return jax.vmap(partial(tool_wrench, *signals.model))(signals.q, signals.dq, signals.ddq)
    return wrenches_in_motion(signals.model.gravity, signals.model.theta, motion_of(signals))


def transform(signals: Signals, values: Values, catalogue: Catalogue = CATALOGUE) -> Signals:
    """Model and motion as they are, where effects say that the believed ones are wrong."""
    for name, effect in catalogue.items():
        if name in values and effect.transform:
            signals = effect.transform(complete(effect, values[name], signals.model), signals)
    return signals


def read(signals: Signals, values: Values, wrench: Array, catalogue: Catalogue = CATALOGUE) -> Array:
    """What the sensor makes of the tool's wrench; (T, 6) -> (T, 6).

    Args:
        signals: after ``transform``.
        values: effect -> parameters.
        wrench: (T, 6) D theta.
        catalogue: the table of effects.
    """
    for name, effect in catalogue.items():
        if name in values and effect.reading:
            wrench = effect.reading(complete(effect, values[name], signals.model), signals, wrench)
    return wrench


def bias(signals: Signals, values: Values, catalogue: Catalogue = CATALOGUE) -> Array:
    """(T, 6) N, Nm: the part of the bias that comes from effects of the bias stage, in the report's sign."""
    of_bias = {name: effect for name, effect in catalogue.items() if effect.stage == "bias"}
    nothing = jnp.zeros((signals.t.shape[0], 6), signals.q.dtype)
    found: Array = -read(signals, values, nothing, of_bias)
    terms = {name: term for name, term in values.get(TERM, {}).items() if term.acts_as == "bias"}
    return found - change(jnp, terms, state_of(jnp, signals, nothing)) if terms else found


def record(key: Array, recorded: Record, model: Model, values: Values, catalogue: Catalogue = CATALOGUE) -> Record:
    """What becomes of the samples on the way to the file. Each effect has random numbers of its own.

    Args:
        key: JAX key.
        recorded: samples with bias and noise: t (T,) s, wrench (T, 6) N, Nm.
        model: what the setup states.
        values: of the effects.
        catalogue: the table of effects.
    """
    for i, (name, effect) in enumerate(catalogue.items()):
        if name in values and effect.recording:
            completed = complete(effect, values[name], model)
            recorded = effect.recording(completed, jax.random.fold_in(key, i), recorded)
    return recorded


def correct_record(wrench: Array, model: Model, values: Values, catalogue: Catalogue = CATALOGUE) -> Array:
    """(T, 6) N, Nm recorded, with NaN where known effects make a sample useless: saturated, spike or repetition."""
    # Backwards: a repetition is recognised before a spike is taken out of it.
    for name, effect in reversed(list(catalogue.items())):
        if name in values and effect.screen:
            wrench = effect.screen(complete(effect, values[name], model), wrench)
    return wrench


def noise_variance(
    variance: Array, rate: Array, model: Model, values: Values, catalogue: Catalogue = CATALOGUE
) -> Array:
    """Variance of the reading's noise with the known effects that act like noise.

    Args:
        variance: (6,) or (T, 6) N^2, Nm^2, as the setup states it.
        rate: (T, 6) N/s, Nm/s, of the noise-free reading.
        model: what the setup states.
        values: of the effects.
        catalogue: the table of effects.

    Returns:
        (T, 6) N^2, Nm^2.
    """
    variance = jnp.broadcast_to(variance, rate.shape)
    for name, effect in catalogue.items():
        if name in values and effect.widen:
            variance = effect.widen(complete(effect, values[name], model), variance, rate)
    return variance


def fill_temperature(t: Array, temperature: Array) -> Array:
    """(T,) deg C without gaps: straight lines between the recorded values; zeros if there are none.

    Args:
        t: (T,) s.
        temperature: (T,) deg C, NaN = not recorded.
    """
    known = np.isfinite(temperature)
    if not known.any():
        return np.zeros_like(temperature)
    return np.interp(t, t[known], temperature[known]).astype(temperature.dtype)
