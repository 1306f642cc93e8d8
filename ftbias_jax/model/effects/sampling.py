"""Effects on single samples: stamp jitter, noise, saturation, quantisation, outliers, and lost or repeated samples."""

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.model.effects.fitting import FLAT_TOPS, GROWTH, JITTER, LATTICE, LEVEL, LOST, SPIKES, Fitting, Samples
from ftbias_jax.model.effects.responses import delayed
from ftbias_jax.model.effects.statements import PERCENT, amount, channels, growth
from ftbias_jax.model.effects.types import Effect, EffectValues, Parameter, Record, Twin, within
from ftbias_jax.model.motion_noise import MotionNoise
from ftbias_jax.types import Array

_NEWTON = np.array([1.0] * 3 + [0.1] * 3)

BEYOND, SPIKES_BEYOND = 1.01, 0.01
"""Ratio of a reading to a stated limit, and share of such readings, from which the limit does not hold on that side."""


def stamp_jitter(values: EffectValues, key: Array, record: Record) -> Record:
    """Samples are taken at times that scatter around their stamps, independently of one another."""
    clean = record.wrench - record.noise
    late = values["std"] * jax.random.normal(key, record.t.shape, record.t.dtype)
    return record._replace(wrench=record.wrench + (delayed(record.t, clean, -late) - clean))


def noise_level(values: EffectValues, key: Array, record: Record) -> Record:
    """The noise is a multiple of the stated one."""
    noise = values["scale"][None] * record.noise
    return record._replace(wrench=record.wrench + (noise - record.noise), noise=noise)


def vibration(values: EffectValues, key: Array, record: Record) -> Record:
    """White noise added to the noise at rest, with a variance that is a sum over the speeds of the motion."""
    if record.dq is None:
        return record
    shaking = jnp.sqrt(shaken(values, record.dq)) * jax.random.normal(key, record.wrench.shape, record.wrench.dtype)
    return record._replace(wrench=record.wrench + shaking, noise=record.noise + shaking)


def shaken(values: EffectValues, dq: Array) -> Array:
    """Variance (T, 6) N^2, Nm^2 that vibration adds at the speeds (T, s) rad/s of ``speeds_of``, NumPy or JAX."""
    rows = dq.__array_namespace__().broadcast_to(values["variance"], (dq.shape[1], 6))
    return MotionNoise(rows, values["speed"]).variance(dq)


def saturation(values: EffectValues, key: Array, record: Record) -> Record:
    """Readings, bias included, are clipped at a limit of either sign."""
    return record._replace(wrench=record.wrench.clip(-values["limits"][None], values["limits"][None]))


def screen_saturated(values: EffectValues, wrench: Array) -> Array:
    """Mask readings at their limit, which only show that the wrench is larger.

    A side on which many readings go beyond the limit has another one: after a tare the limits of the two sides differ.
    """
    margin, limit = 1 - 8 * np.finfo(wrench.dtype).eps, values["limits"][None]  # rounded to the log's precision
    at_limit = jnp.zeros(wrench.shape, bool)
    for outward in (wrench, -wrench):
        beyond = (outward > BEYOND * limit).mean(0, keepdims=True) > SPIKES_BEYOND
        at_limit |= (outward >= margin * limit) & ~beyond
    return jnp.where(at_limit, jnp.nan, wrench)


def quantisation(values: EffectValues, key: Array, record: Record) -> Record:
    """Readings are multiples of a step; a step of 0 leaves a channel unchanged."""
    step, xp = values["step"][None], record.wrench.__array_namespace__()
    safe = xp.where(step > 0, step, 1)
    return record._replace(wrench=xp.where(step > 0, safe * xp.round(record.wrench / safe), record.wrench))


def outliers(values: EffectValues, key: Array, record: Record) -> Record:
    """Some samples are off by a fixed size, with a random sign in every channel."""
    which, sign = jax.random.split(key)
    hit = jax.random.bernoulli(which, values["rate"], record.t.shape)
    spike = values["size"][None] * jax.random.rademacher(sign, record.wrench.shape, record.wrench.dtype)
    return record._replace(wrench=record.wrench + jnp.where(hit[:, None], spike, 0))


def screen_outliers(values: EffectValues, wrench: Array) -> Array:
    """Mask samples that are off both neighbours by over half a spike, to the same side, in any channel with spikes."""
    before, after = wrench[:-2], wrench[2:]
    low, high = jnp.minimum(before, after), jnp.maximum(before, after)
    outside = jnp.maximum(low - wrench[1:-1], wrench[1:-1] - high)
    size = values["size"][None]
    spike = ((outside > size / 2) & (size > 0)).any(1) & (values["rate"] > 0)
    spike = jnp.pad(spike, 1)  # The first and last sample have one neighbour only and are kept.
    return jnp.where(spike[:, None], jnp.nan, wrench)


def dropped_samples(values: EffectValues, key: Array, record: Record) -> Record:
    """A share of the samples is lost; of those, a share repeats the last one, the rest is missing (NaN)."""
    which, how = jax.random.split(key)
    lost = jax.random.bernoulli(which, values["rate"], record.t.shape).at[0].set(False)
    repeats = jax.random.bernoulli(how, values["repeated"], record.t.shape)
    last = jax.lax.cummax(jnp.where(lost, 0, jnp.arange(record.t.shape[0])))
    missing = (lost & ~repeats)[:, None]
    return record._replace(wrench=jnp.where(missing, jnp.nan, record.wrench[last]))


def screen_repeats(values: EffectValues, wrench: Array) -> Array:
    """Mask samples that equal the previous one in all channels; with noise only a repeated sample does."""
    same = (wrench[1:] == wrench[:-1]).all(1) & (values["rate"] > 0)
    return jnp.where(jnp.pad(same, (1, 0))[:, None], jnp.nan, wrench)


EFFECTS = (
    Effect(
        "stamp_jitter",
        "timing",
        (Parameter("std", "s", "standard deviation of a stamp's error", (), 0.0, 1.0, 0.0, 2e-3, search=True),),
        "stamps scatter around the time of measurement",
        "use the hardware's stamps instead of the arrival time",
        recording=stamp_jitter,
        fit=Fitting(Samples(JITTER)),
        widen=lambda values, variance, rate: variance + (values["std"] * rate) ** 2,
        twins=(Twin("noise_level", False, "hold still: the noise of jitter grows with the rate of the wrench"),),
        statement=amount("stamps scatter by {value} ms about the time of measurement", "std", 1e3),
    ),
    Effect(
        "noise_level",
        "sensor",
        (Parameter("scale", "1", "noise per stated noise, channel by channel", (6,), 0.0, 1e3, 1.0, 1.0, search=True),),
        "the sensor's noise is not as large as the setup says",
        "correct sensor.noise_std in the setup: ftbias tune",
        recording=noise_level,
        fit=Fitting(Samples(LEVEL)),
        twins=(
            Twin("vibration", False, "hold still for some seconds, then move: noise of another size does not change"),
        ),
        statement=channels("the noise of {channel} departs from the stated one by {value}", "scale", 1.0, "%", PERCENT),
    ),
    Effect(
        "vibration",
        "sensor",
        (
            Parameter(
                "variance",
                "N^2/(rad/s)^2, Nm^2/(rad/s)^2",
                "noise variance per squared speed of a joint: a row of six channels for each joint, or one for all or "
                "for the turning of a recorded pose",
                **within((-1, 6), 0.0, 1e6, 0.0, (0.25 * _NEWTON[None]) ** 2, search=True),
            ),
            Parameter(
                "speed",
                "rad/s",
                "from which the part of a joint in the variance grows with the speed and no longer with its square",
                **within((), 1e-4, np.inf, np.inf, 0.5, search=True, optional=True),
            ),
        ),
        "the noise grows with the speed of the motion; at rest it is what the setup says",
        "keep it in the setup, so that the filter trusts fast motion less; look for loose screws, worn gears and "
        "cables that shake; tare at rest",
        recording=vibration,
        fit=Fitting(Samples(GROWTH, first=True)),
        twins=(
            Twin("noise_level", False, "hold still for some seconds: the noise of vibration is then gone"),
            Twin("stamp_jitter", False, "move fast without load: the noise of jitter needs a wrench that changes"),
        ),
        filter_noise="vibration",
        statement=growth("noise grows with motion: {value} of {channel} at 1 rad/s", "variance"),
    ),
    Effect(
        "saturation",
        "sensor",
        (
            Parameter(
                "limits",
                "N, Nm",
                "largest reading of either sign, channel by channel",
                **within((6,), 1e-3, np.inf, np.inf, 10 * _NEWTON, search=True),
            ),
        ),
        "readings stop at the end of the sensor's range",
        "tare the sensor or use one with a larger range; these samples are left out",
        recording=saturation,
        fit=Fitting(Samples(FLAT_TOPS, first=True)),
        screen=screen_saturated,
        statement=channels("readings of {channel} stop at {value}", "limits", exact=True),
    ),
    Effect(
        "quantisation",
        "sensor",
        (
            Parameter(
                "step",
                "N, Nm",
                "distance of neighbouring readings, channel by channel",
                **within((6,), 0.0, 1e3, 0.0, 0.01 * _NEWTON, search=True),
            ),
        ),
        "readings lie on a coarse lattice",
        "log more digits, or choose a smaller range in the sensor's settings",
        recording=quantisation,
        fit=Fitting(Samples(LATTICE)),
        widen=lambda values, variance, rate: variance + values["step"][None] ** 2 / 12,  # The error is uniform.
        statement=channels("readings of {channel} come in steps of {value}", "step", exact=True),
    ),
    Effect(
        "outliers",
        "sensor",
        (
            Parameter("rate", "1", "share of samples that are hit", (), 0.0, 0.5, 0.0, 0.005, search=True),
            Parameter("size", "N, Nm", "size of the spikes, channel by channel", (6,), 0, 1e5, 0, 5 * _NEWTON),
        ),
        "single samples are far off",
        "check cable, shielding and driver; these samples are left out",
        recording=outliers,
        fit=Fitting(Samples(SPIKES)),
        screen=screen_outliers,
        statement=amount("{value} % of the samples are spikes", "rate", PERCENT),
    ),
    Effect(
        "dropped_samples",
        "timing",
        (
            Parameter("rate", "1", "share of samples that are lost", (), 0.0, 0.95, 0.0, 0.02, search=True),
            Parameter(
                "repeated",
                "1",
                "share of the lost samples that repeat the last one; the rest is missing",
                **within((), 0.0, 1.0, 1.0, 0.0, search=True, optional=True),
            ),
        ),
        "the driver loses samples or repeats old ones",
        "check the load of the recording computer; repeated samples are left out",
        recording=dropped_samples,
        fit=Fitting(Samples(LOST)),
        screen=screen_repeats,
        statement=amount("{value} % of the samples are missing or repeated", "rate", PERCENT),
    ),
)
