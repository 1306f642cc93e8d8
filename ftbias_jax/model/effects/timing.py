"""Effects of the timing stage: stamps that jitter, samples that are lost or repeated."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from ftbias_jax.model.effects import fitting
from ftbias_jax.model.effects.fitting import Fitting, Samples
from ftbias_jax.model.effects.responses import delayed
from ftbias_jax.model.effects.statements import PERCENT, amount
from ftbias_jax.model.effects.types import Effect, EffectValues, Parameter, Record, Twin
from ftbias_jax.types import Array


def stamp_jitter(values: EffectValues, key: Array, record: Record) -> Record:
    """Samples are taken at times that scatter around their stamps, independently of one another."""
    clean = record.wrench - record.noise
    late = values["std"] * jax.random.normal(key, record.t.shape, record.t.dtype)
    return record._replace(wrench=record.wrench + (delayed(record.t, clean, -late) - clean))


def widen_jitter(values: EffectValues, variance: Array, rate: Array) -> Array:
    """A time error acts like noise of the size of the rate."""
    return variance + (values["std"] * rate) ** 2


def dropped_samples(values: EffectValues, key: Array, record: Record) -> Record:
    """A share of the samples is lost; of those, a share repeats the last one, the rest is missing (NaN)."""
    which, how = jax.random.split(key)
    lost = jax.random.bernoulli(which, values["rate"], record.t.shape).at[0].set(False)
    repeats = jax.random.bernoulli(how, values["repeated"], record.t.shape)
    last = jax.lax.cummax(jnp.where(lost, 0, jnp.arange(record.t.shape[0])))
    missing = (lost & ~repeats)[:, None]
    return record._replace(wrench=jnp.where(missing, jnp.nan, record.wrench[last]))


def screen_repeats(values: EffectValues, wrench: Array) -> Array:
    """With noise no two samples agree in all channels, so one that does is a repetition."""
    same = (wrench[1:] == wrench[:-1]).all(1) & (values["rate"] > 0)
    return jnp.where(jnp.pad(same, (1, 0))[:, None], jnp.nan, wrench)


JITTER = (
    Effect(
        "stamp_jitter",
        "timing",
        (Parameter("std", "s", "standard deviation of a stamp's error", (), 0.0, 1.0, 0.0, 2e-3, search=True),),
        "stamps scatter around the time of measurement",
        "use the hardware's stamps instead of the arrival time",
        recording=stamp_jitter,
        fit=Fitting(Samples(fitting.JITTER)),
        widen=widen_jitter,
        twins=(Twin("noise_level", False, "hold still: the noise of jitter grows with the rate of the wrench"),),
        statement=amount("stamps scatter by {value} ms about the time of measurement", "std", 1e3),
    ),
)
"""Acts when a sample is taken."""

DROPS = (
    Effect(
        "dropped_samples",
        "timing",
        (
            Parameter("rate", "1", "share of samples that are lost", (), 0.0, 0.95, 0.0, 0.02, search=True),
            Parameter(
                "repeated",
                "1",
                "share of the lost samples that repeat the last one; the rest is missing",
                (),
                0.0,
                1.0,
                1.0,
                0.0,
                search=True,
                optional=True,
            ),
        ),
        "the driver loses samples or repeats old ones",
        "check the load of the recording computer; repeated samples are left out",
        recording=dropped_samples,
        fit=Fitting(Samples(fitting.LOST)),
        screen=screen_repeats,
        statement=amount("{value} % of the samples are missing or repeated", "rate", PERCENT),
    ),
)
"""Acts on the way to the file."""
