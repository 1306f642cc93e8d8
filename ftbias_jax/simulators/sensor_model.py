"""Errors of the sensor itself, sample by sample, for any simulator: actual wrench -> reading.

Pure functions of NumPy or JAX arrays, whichever they are given. The first axis of a wrench counts environments; the
effects are those of the catalogue, which take it for the axis of samples.
"""

from types import SimpleNamespace
from typing import Any, NamedTuple

import jax
import numpy as np

from ftbias_jax.model.effects.bias import bias_jump, warmup
from ftbias_jax.model.effects.responses import lag_factors, play
from ftbias_jax.model.effects.sampling import quantisation, saturation, shaken
from ftbias_jax.model.effects.sensor import crosstalk, gain
from ftbias_jax.model.effects.types import Record, Values
from ftbias_jax.model.simulate import bias_steps
from ftbias_jax.simulators.memory import delayed_by, lagging_behind
from ftbias_jax.types import Array

EFFECTS = (
    *("gain", "crosstalk", "hysteresis", "low_pass", "warmup", "temperature_drift", "bias_jump", "time_delay"),
    *("stamp_jitter", "noise_level", "vibration", "saturation", "quantisation", "outliers", "dropped_samples"),
)
"""Effects of the sensor itself, in the order of the catalogue, in which ``SensorModel.step`` applies them."""
_AT_NO_TIME: Any = None
"""Placeholder for the signals, because gain and crosstalk depend only on the wrench."""


class Draws(NamedTuple):
    """Random numbers of one sample in N environments; None = not needed."""

    kick: Array
    """(N, 6) standard normal: process noise of the drift."""
    slip: Array
    """(N, 6) standard normal: process noise of the bias that is independent of the drift's."""
    white: Array
    """(N, 6) standard normal: white measurement noise of the sample."""
    shaking: Array | None = None
    """(N, 6) standard normal: noise caused by the motion."""
    correlated: Array | None = None
    """(N, 6) standard normal: driving noise of the correlated noise."""
    late: Array | None = None
    """(N, 1) standard normal: jitter of the stamp."""
    events: Array | None = None
    """(N, 3) uniform from 0 to 1: decides on an outlier, a dropped sample, and whether that repeats the last one."""
    spike: Array | None = None
    """(N, 6) uniform from 0 to 1: signs of the outlier."""


class SensorState(NamedTuple):
    """State of the sensor in N environments."""

    t: Array
    """(N,) s since the start."""
    played: Array
    """(N, 6) N, Nm: load after gain, crosstalk and hysteresis."""
    lag: Array
    """(N, 3, 6) state of the low-pass: output minus input, N, Nm; for the second order its oscillating part, the rate
    of that, and the slope of the input, N/s, Nm/s (``responses.lagged``)."""
    warmth: Array
    """(N, 3) deg C: thermometer, gauges minus thermometer, gauges at the start."""
    clean: Array
    """(N, 6) N, Nm: last wrench before bias process and noise."""
    ages: Array
    """(N, L) s: ages of the last samples, the newest last; for the delay."""
    history: Array
    """(N, L, 6) N, Nm: wrenches of these samples."""
    bias: Array
    """(N, 6) N, Nm: bias process, unbiased = reading + bias."""
    drift: Array
    """(N, 6) N/s, Nm/s: drift of the bias."""
    correlated: Array
    """(N, 6) N, Nm: noise that is correlated in time."""
    reading: Array
    """(N, 6) N, Nm: last reading that was not dropped."""


class SensorModel(NamedTuple):
    """A sensor's errors: noise, bias process, and effects of ``EFFECTS``. Arrays of NumPy or of JAX; a pytree."""

    noise_std: Array
    """(6,) N, Nm: standard deviation of the white noise of one sample."""
    density: Array
    """(6,) N/s^1.5, Nm/s^1.5: noise density of the drift's random walk."""
    initial: Array
    """(12,) N, Nm, N/s, Nm/s: expected bias and drift at the start."""
    initial_std: Array
    """(12,) standard deviations of bias and drift at the start."""
    sign: Array
    """() 1 if the sensor reports the wrench on the tool, -1 if that on the sensor."""
    tared: Array
    """() 1 if the sensor is set to zero at the start, with the tool on, else 0."""
    values: Values
    """Effect -> parameter -> value; absent effects cost no time."""
    correlated_std: Array | None = None
    """(6,) N, Nm: standard deviation of the correlated noise; None = all noise is white."""
    correlated_time: Array | None = None
    """(6,) s: correlation time of the correlated noise."""
    drift_time: Array | None = None
    """(6,) s: time constant with which the drift reverts to zero; None = never."""

    def memory(self, dt: float) -> int:
        """Number of samples, at least dt s apart, that a delay needs."""
        delay = float(self.values["time_delay"]["delay"]) if "time_delay" in self.values else 0.0
        return int(np.ceil(max(delay, 0.0) / dt)) + 2

    def draw(self, random: Any, count: int = 1) -> Draws:
        """Random numbers of one sample in ``count`` environments, from a JAX key or a NumPy generator."""
        has = self.values.keys()
        normals = 3 + ("vibration" in has) + (self.correlated_std is not None) + ("stamp_jitter" in has)
        uniforms = 2 * bool(has & {"outliers", "dropped_samples"})
        normal: Array
        uniform: Array
        if isinstance(random, np.random.Generator):
            normal, uniform = random.normal(size=(normals, count, 6)), random.random((uniforms, count, 6))
        else:
            dtype = jax.numpy.asarray(self.noise_std).dtype
            keys = jax.random.split(random) if uniforms else (random, random)  # splitting costs as much as drawing
            # Drawn as one row, because XLA takes three times as long in this shape.
            normal = jax.random.normal(keys[0], (normals * count * 6,), dtype).reshape(normals, count, 6)
            uniform = jax.random.uniform(keys[1], (uniforms * count * 6,), dtype).reshape(uniforms, count, 6)
        rows = iter(normal[3:])
        return Draws(
            normal[0],
            normal[1],
            normal[2],
            shaking=next(rows) if "vibration" in has else None,
            correlated=next(rows) if self.correlated_std is not None else None,
            late=next(rows)[:, :1] if "stamp_jitter" in has else None,
            events=uniform[0, :, :3] if uniforms else None,
            spike=uniform[1] if uniforms else None,
        )

    def start(
        self, wrench: Array, draws: Draws, temperature: Array | float = 25.0, memory: int = 2, t: Array | float = 0.0
    ) -> SensorState:
        """State at the start, settled at the first wrench, with the bias drawn by ``slip`` and the drift by ``kick``.

        Args:
            wrench: (6,), or (N, 6) of N environments; N, Nm, sensor frame: the force and torque that an ideal sensor
                exerts on the tool, as MuJoCo's force and torque sensors report.
            draws: random numbers of these environments.
            temperature: () or (N,) deg C.
            memory: number of samples kept for a delay: ``SensorModel.memory``.
            t: () or (N,) s since the start of the process that ``warmup`` and ``bias_jump`` count from.
        """
        xp, load = wrench.__array_namespace__(), self._leaked(wrench.reshape(-1, 6))
        none, length = 0 * load, memory if "time_delay" in self.values else 0
        t, warm = t + none[:, 0], temperature + none[:, 0]
        clean = self._with_bias_effects(load, t, 0 * t)
        bias = self.initial[None, :6] + self.initial_std[None, :6] * draws.slip + self.tared * clean
        return SensorState(
            t=t,
            played=load,
            lag=xp.stack([none] * 3, 1),
            warmth=xp.stack([warm, 0 * warm, warm], 1),
            clean=clean,
            ages=xp.zeros((len(load), length), load.dtype),
            history=clean[:, None] + xp.zeros((1, length, 1), load.dtype),
            bias=bias,
            drift=self.initial[None, 6:] + self.initial_std[None, 6:] * draws.kick,
            correlated=none if self.correlated_std is None else self.correlated_std[None] * draws.correlated,
            reading=clean - bias,
        )

    def step(
        self,
        state: SensorState,
        wrench: Array,
        dt: Array | float,
        draws: Draws,
        dq: Array | None = None,
        temperature: Array | float | None = None,
    ) -> tuple[SensorState, Array]:
        """Advance by one sample, at the sensor's rate.

        Args:
            state: state after the previous sample.
            wrench: (6,) or (N, 6) N, Nm, as for ``start``.
            dt: () or (N,) s since the previous sample.
            draws: random numbers of this sample.
            dq: (n,) or (N, n) rad/s, joint velocities, or the one angular speed of the body, for ``vibration``; None =
                at rest.
            temperature: () or (N,) deg C, for ``temperature_drift``; None = unchanged.

        Returns:
            The next state, and the reading in the shape of ``wrench``, in the sensor's reported sign; NaN = dropped.
        """
        xp, dt = wrench.__array_namespace__(), dt + 0 * state.t
        values, t, load = self.values, state.t + dt, self._leaked(wrench.reshape(-1, 6))
        played = play(state.played, load, values["hysteresis"]["width"][None]) if "hysteresis" in values else load
        behind, lag, warmth = 0.0, state.lag, state.warmth
        if "low_pass" in values:
            behind, lag = lagging_behind(values["low_pass"], lag, played - state.played, dt[:, None])
        if "temperature_drift" in values and temperature is not None:
            warmth = self._warmed(warmth, temperature + 0 * dt, dt)
        clean = self._with_bias_effects(played + behind, t, warmth[:, 0] + warmth[:, 1] - warmth[:, 2])
        ages, history = state.ages, state.history
        if "time_delay" in values:
            ages = xp.concatenate([ages[:, 1:] + dt[:, None], 0 * ages[:, :1]], 1)
            history = xp.concatenate([history[:, 1:], clean[:, None]], 1)
            clean = delayed_by(values["time_delay"]["delay"], ages, history)
        bias, drift, correlated = self._process(state, dt[:, None], draws)
        reading = self._recorded(clean, (clean - state.clean) / dt[:, None], clean - bias + correlated, draws, dq)
        kept, reading = self._delivered(state.reading, reading, draws)
        following = SensorState(t, played, lag, warmth, clean, ages, history, bias, drift, correlated, kept)
        return following, (self.sign * reading).reshape(wrench.shape)

    def _leaked(self, wrench: Array) -> Array:
        """(N, 6) load after gain and crosstalk."""
        for name, effect in (("gain", gain), ("crosstalk", crosstalk)):
            if name in self.values:
                wrench = effect(self.values[name], _AT_NO_TIME, wrench)
        return wrench

    def _warmed(self, warmth: Array, temperature: Array, dt: Array) -> Array:
        """The next ``SensorState.warmth``."""
        lag = self.values["temperature_drift"]["lag"]
        xp = warmth.__array_namespace__()
        decay, passed = lag_factors(dt, xp.where(lag > 0, 1 / (2 * np.pi * xp.where(lag > 0, lag, 1)), np.inf))
        behind = decay * warmth[:, 1] - passed * (temperature - warmth[:, 0])
        return xp.stack([temperature, behind, warmth[:, 2]], 1)

    def _with_bias_effects(self, wrench: Array, t: Array, warmer: Array) -> Array:
        """(N, 6) wrench minus the biases of effects at t (N,) s and ``warmer`` (N,) K above the start's temperature."""
        at: Any = SimpleNamespace(t=t)  # the only field of ``Signals`` that these effects use
        if "warmup" in self.values:
            wrench = warmup(self.values["warmup"], at, wrench)
        if "temperature_drift" in self.values:
            wrench = wrench - warmer[:, None] * self.values["temperature_drift"]["per_kelvin"][None]
        return bias_jump(self.values["bias_jump"], at, wrench) if "bias_jump" in self.values else wrench

    def _process(self, state: SensorState, dt: Array, draws: Draws) -> tuple[Array, Array, Array]:
        """The next bias, drift and correlated noise (N, 6); dt (N, 1) s."""
        gained, slipped = bias_steps(dt, self.density[None], draws.kick, draws.slip)
        kept, moved = (
            (1.0, 1.0) if self.drift_time is None else lag_factors(dt, 1 / (2 * np.pi * self.drift_time[None]))
        )
        bias, drift = state.bias + dt * moved * state.drift + slipped, kept * state.drift + gained
        if self.correlated_std is None or self.correlated_time is None:
            return bias, drift, state.correlated
        forgotten, _ = lag_factors(dt, 1 / (2 * np.pi * self.correlated_time[None]))
        fresh = self.correlated_std[None] * (1 - forgotten**2) ** 0.5 * draws.correlated
        return bias, drift, forgotten * state.correlated + fresh

    def _recorded(self, clean: Array, rate: Array, reading: Array, draws: Draws, dq: Array | None) -> Array:
        """(N, 6) reading with noise, saturation and quantisation; jitter extrapolates by the wrench's rate (N, 6)."""
        values, white = self.values, self.noise_std[None] * draws.white
        if "stamp_jitter" in values:
            reading = reading + values["stamp_jitter"]["std"] * draws.late * rate
        if "noise_level" in values:
            white = values["noise_level"]["scale"][None] * white
        if "vibration" in values and dq is not None:
            variance = shaken(values["vibration"], dq.reshape(-1, dq.shape[-1]))
            xp, moves = dq.__array_namespace__(), variance > 0  # the square root is not differentiable at rest
            white = white + xp.where(moves, xp.where(moves, variance, 1.0) ** 0.5, 0.0) * draws.shaking
        record = Record(clean[:, 0], reading + white, white)
        for name, effect in (("saturation", saturation), ("quantisation", quantisation)):
            if name in values:
                record = effect(values[name], None, record)
        return record.wrench

    def _delivered(self, last: Array, reading: Array, draws: Draws) -> tuple[Array, Array]:
        """Last reading (N, 6) that was not dropped, and the reading that is delivered."""
        xp, values = reading.__array_namespace__(), self.values
        if "outliers" in values and draws.events is not None and draws.spike is not None:
            spike = values["outliers"]["size"][None] * xp.where(draws.spike < 0.5, -1.0, 1.0)
            reading = reading + xp.where(draws.events[:, :1] < values["outliers"]["rate"], spike, 0.0)
        if "dropped_samples" not in values or draws.events is None:
            return reading, reading
        lost = draws.events[:, 1:2] < values["dropped_samples"]["rate"]
        repeats = draws.events[:, 2:] < values["dropped_samples"]["repeated"]
        return xp.where(lost, last, reading), xp.where(lost, xp.where(repeats, last, np.nan), reading)
