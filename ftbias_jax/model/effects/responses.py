"""Dynamic responses, exact for a signal that is linear between its samples, at any sample times.

Stamps increase; a log may end in repeated ones (padding). At zero strength each function returns its input signal.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.runtime.compiled_loops import compile_whole
from ftbias_jax.types import Array

FIRST, SECOND = 1, 2
BUTTERWORTH = 0.5**0.5
"""Damping ratio of the second-order filter whose pass band is maximally flat."""


def lagged(t: Array, signal: Array, cutoff: Array, order: Array | int = FIRST) -> Array:
    """Low-pass of a signal (T, k) at t (T,) s, settled at the first sample; a cutoff of inf Hz passes everything.

    First order, with input u and tau = 1 / (2 pi cutoff): the lag e = y - u obeys e' = -e / tau - u', so over a step of
    x = dt / tau: e <- exp(-x) e - (u_new - u_old) (1 - exp(-x)) / x. Second order, the Butterworth filter
    w^2 / (s^2 + 2 zeta w s + w^2) with w = 2 pi cutoff: for an input of slope v the output settles at u - 2 zeta v / w
    and rings around it like ``rung``, displaced by every change of the slope.
    """
    decay, passed = lag_factors(jnp.diff(t, prepend=t[:1]), cutoff)
    step = jnp.diff(signal, axis=0, prepend=signal[:1])
    lag = _lag(decay, -passed[:, None] * step)
    if isinstance(order, int) and order == FIRST:
        return signal + lag
    slope = _slopes(t, signal)
    rigid, w, cosine, sine = _oscillator_factors(jnp.diff(t), cutoff, BUTTERWORTH)
    behind = 2 * BUTTERWORTH / w
    kick = -jnp.diff(slope, axis=0, prepend=jnp.zeros_like(slope[:1]))
    deviation = _oscillator(w, jnp.full_like(w, BUTTERWORTH), behind, cosine, sine, kick) - behind * slope
    second = jnp.where(rigid, 0, jnp.concatenate([jnp.zeros_like(signal[:1]), deviation]))
    return signal + jnp.where(jnp.asarray(order) > (FIRST + SECOND) / 2, second, lag)


def lag_factors(dt: Array, cutoff: Array) -> tuple[Array, Array]:
    """exp(-x) and (1 - exp(-x)) / x of ``lagged`` for steps dt (...,) s, NumPy or JAX; 1 and 1 for a step of 0 s."""
    xp = dt.__array_namespace__()
    x = xp.where(dt > 0, 2 * np.pi * cutoff * dt, 0)
    safe = xp.where(x > 0, x, 1)
    return xp.exp(-x), xp.where(x > 0, -xp.expm1(-safe) / safe, 1)


@compile_whole
def _lag(decay: Array, kick: Array) -> Array:
    """First-order recursion: decay (T,) since the previous sample, and input (T, k) of each sample -> (T, k)."""

    def body(lag: Array, inputs: tuple[Array, Array]) -> tuple[Array, Array]:
        decay, kick = inputs
        lag = decay * lag + kick
        return lag, lag

    return jax.lax.scan(body, jnp.zeros_like(kick[0]), (decay, kick))[1]


def rung(t: Array, signal: Array, frequency: Array, damping_ratio: Array) -> Array:
    """Response (2 zeta w s + w^2) / (s^2 + 2 zeta w s + w^2) of a signal (T, k) transmitted by spring and damper.

    The deviation e = y - u obeys e'' + 2 zeta w e' + w^2 e = -u'': between samples it oscillates freely, at a sample
    its rate drops by the change of the input's slope. It is at rest until the first change. The undamped frequency is
    in Hz, and inf passes everything; the damping ratio is from 0 to below 1.
    """
    slope = _slopes(t, signal)
    rigid, w, cosine, sine = _oscillator_factors(jnp.diff(t), frequency, damping_ratio)
    # A kick acts at the start of each interval but the first, whose slope is assumed to have existed before.
    kick = -jnp.diff(slope, axis=0, prepend=slope[:1])
    deviation = _oscillator(w, damping_ratio, jnp.zeros_like(w), cosine, sine, kick)
    return signal + jnp.where(rigid, 0, jnp.concatenate([jnp.zeros_like(signal[:1]), deviation]))


def _slopes(t: Array, signal: Array) -> Array:
    """Slopes (T - 1, k) between the samples of a signal (T, k); 0 between repeated stamps."""
    dt = jnp.diff(t)
    return jnp.diff(signal, axis=0) / jnp.where(dt > 0, dt, jnp.inf)[:, None]


def _oscillator_factors(dt: Array, frequency: Array, damping_ratio: Any) -> tuple[Array, Array, Array, Array]:
    """Whether a frequency in Hz is infinite; the frequency in rad/s, of 1 Hz if so; and ``oscillator_factors``."""
    rigid = ~jnp.isfinite(frequency)
    w = 2 * jnp.pi * jnp.where(rigid, 1, frequency)
    return rigid, w, *oscillator_factors(dt, w, damping_ratio)


def oscillator_factors(dt: Array, w: Array, damping_ratio: Any) -> tuple[Array, Array]:
    """Damped cosine, and damped sine per damped frequency, s, over steps dt (...,) s for ``oscillator_step``."""
    xp, damped = dt.__array_namespace__(), w * (1 - damping_ratio**2) ** 0.5
    envelope = xp.exp(-damping_ratio * w * dt)
    return envelope * xp.cos(damped * dt), envelope * xp.sin(damped * dt) / damped


def oscillator_step(
    deviation: Array, rate: Array, w: Array, damping_ratio: Any, cosine: Array, sine: Array
) -> tuple[Array, Array]:
    """Deviation and rate of a free damped oscillation one step later; w is the undamped frequency, rad/s."""
    return (
        cosine * deviation + sine * (rate + damping_ratio * w * deviation),
        cosine * rate - sine * (w**2 * deviation + damping_ratio * w * rate),
    )


@compile_whole
def _oscillator(w: Array, damping_ratio: Any, behind: Array, cosine: Array, sine: Array, kick: Array) -> Array:
    """Deviation (T, k) at the end of every interval, for kicks (T, k) at their starts; cosine, sine (T,).

    A kick is added to the rate, and ``behind`` () s times it is subtracted from the deviation.
    """

    def body(state: tuple[Array, Array], inputs: tuple[Array, ...]) -> tuple[tuple[Array, Array], Array]:
        (deviation, rate), (cosine, sine, kick) = state, inputs
        state = oscillator_step(deviation - behind * kick, rate + kick, w, damping_ratio, cosine, sine)
        return state, state[0]

    zero = jnp.zeros_like(kick[0])
    return jax.lax.scan(body, (zero, zero), (cosine, sine, kick))[1]


@compile_whole
def played(signal: Array, width: Array) -> Array:
    """Play (backlash) operator: the output follows a signal (T, k) once that has crossed a gap of width (k,).

    The signal starts in the middle of the gap.
    """

    def body(output: Array, value: Array) -> tuple[Array, Array]:
        output = play(output, value, width)
        return output, output

    return jax.lax.scan(body, signal[0], signal)[1]


def play(output: Array, value: Array, width: Array) -> Array:
    """The next output (..., k) of the play operator for the next value (..., k), NumPy or JAX."""
    return output.__array_namespace__().clip(output, value - width / 2, value + width / 2)


def delayed(t: Array, signal: Array, delay: Array) -> Array:
    """Signal (T, k) at t - delay, () or (T,) s, by linear interpolation; outside the log its first or last value."""
    when = jnp.minimum(t - delay, t[-1])
    # From the left, because padding repeats the last stamp, and its states are not those of the last sample.
    before = jnp.clip(jnp.searchsorted(t, when, side="left") - 1, 0, t.shape[0] - 2)
    length = t[before + 1] - t[before]
    share = jnp.clip((when - t[before]) / jnp.where(length > 0, length, 1), 0, 1)[:, None]
    return (1 - share) * signal[before] + share * signal[before + 1]


def decay_time(frequency: Array, damping_ratio: Array) -> Array:
    """Time constant () s with which an oscillation of this undamped frequency, Hz, and damping ratio decays."""
    return 1 / (2 * np.pi * frequency * damping_ratio)


def recurrence(xp: Any, decay: Array, kick: Array) -> Array:
    """y_k = decay_k y_(k-1) + kick_k from y_(-1) = 0, in log2(T) passes; decay (T, 1) may be complex, kick (T, k)."""
    step, length = 1, kick.shape[0]
    while step < length:
        kick = xp.concatenate([kick[:step], kick[step:] + decay[step:] * kick[:-step]])
        decay = xp.concatenate([decay[:step], decay[step:] * decay[:-step]])
        step *= 2
    return kick


def low_passed(xp: Any, t: Array, signal: Array, time_constant: Array) -> Array:
    """First-order lag of a signal (T, k) with a time constant () s, settled at the first value before each log."""
    dt = xp.diff(t, prepend=t[:1])[:, None]
    decay = xp.where(dt < 0, 0.0, xp.exp(-xp.abs(dt) / xp.maximum(time_constant, 1e-6)))
    return signal[:1] + recurrence(xp, decay, (1 - decay) * (signal - signal[:1]))


def swing(xp: Any, t: Array, signal: Array, frequency: Array, damping_ratio: Array) -> Array:
    """Deviation y - u of a mass on spring and damper that is driven by the signal u (T, k), at rest before each log.

    The deviation e obeys e'' + 2 zeta w e' + w^2 e = -u''. With u piecewise linear, u'' is a series of kicks and e the
    imaginary part of one complex recurrence. The undamped frequency is in Hz, the damping ratio from 0 to below 1.
    """
    w = 2 * xp.pi * frequency
    damped = w * xp.sqrt(1 - damping_ratio**2)
    dt = xp.diff(t)[:, None]
    slope = xp.diff(signal, axis=0) / xp.where(dt > 0, dt, xp.inf)
    begins = dt < 0  # Another log begins, into which neither the oscillation nor the slope continues.
    kick = xp.diff(slope, axis=0, prepend=slope[:1])
    kick = xp.where(begins | xp.concatenate([begins[:1] & False, begins[:-1]]), 0.0, kick)
    rotation = xp.where(begins, 0.0, xp.exp((-damping_ratio * w + 1j * damped) * xp.abs(dt)))
    later = recurrence(xp, xp.concatenate([rotation[:1], rotation[:-1]]), kick + 0j)
    deviation = -(rotation * later).imag / damped
    return xp.concatenate([xp.zeros_like(signal[:1]), deviation])
