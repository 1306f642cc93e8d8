"""Parameters of robot, tool, sensor and noise that the filter assumes, as one differentiable bundle of arrays."""

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, Self

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ftbias_jax.errors import SetupError
from ftbias_jax.model.effects.catalogue import Catalogue, values_from_setup, values_of
from ftbias_jax.model.effects.types import Values
from ftbias_jax.model.kinematics.recorded_pose import FreeBody
from ftbias_jax.model.kinematics.screws import Arm
from ftbias_jax.model.motion_noise import MotionNoise
from ftbias_jax.model.own_effects import catalogue_of_setup, check_observable
from ftbias_jax.model.wrench.tool_wrench import DataNoise, data_variance, tool_parameters
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.setup.require import require_tool, with_guessed_tool
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

NOISE_LEVEL = "noise_level"
"""Name of the effect that scales the sensor's own noise."""


class JointNoise(NamedTuple):
    """Noise and prior of the joint filter."""

    process_density: Float[Array, " n"]
    """(n,) strength of the process noise, units of the process model (rad/s^2.5 for integrated jerk)."""
    position_std: Float[Array, " n"]
    """(n,) eta_q, rad: standard deviation of the position noise."""
    velocity_std: Float[Array, " n"]
    """(n,) eta_dq, rad/s: standard deviation of the velocity noise."""
    prior_std: Float[Array, " 3"]
    """(3,) rad, rad/s, rad/s^2: square root of P_0; wide enough for a log that starts in motion (errata 15)."""


class BiasNoise(NamedTuple):
    """Noise and prior of the bias filter."""

    density: Float[Array, " 6"]
    """(6,) sigma_Q, N/s^1.5 and Nm/s^1.5: white noise on the rate of the drift, one per axis."""
    data_variance: Float[Array, " 36"] | None
    """(36,) diagonal of Sigma_D over LIVE_ENTRIES of vec(D), column-major (tool_wrench.py); None = 0."""
    wrench_variance: Float[Array, " 6"]
    """(6,) diagonal of Sigma_W, N^2 and Nm^2."""
    prior_mean: Float[Array, " 12"]
    """(12,) x_0: bias, then drift; a previously estimated bias or zeros."""
    prior_std: Float[Array, " 12"]
    """(12,) square root of the diagonal of P_0."""
    vibration: Array | None = None
    """(s, 6) N^2/(rad/s)^2, Nm^2/(rad/s)^2: variance of each axis per squared speed of each joint, or per squared
    angular speed of a recorded pose (``speeds_of``); None = no such noise."""
    vibration_speed: Float[Array, ""] | None = None
    """() rad/s above which this variance grows with the speed instead of its square: the squared speed counts as
    dq^2 / sqrt(1 + (dq / vibration_speed)^2); None = with the square at any speed."""
    correlated_std: Array | None = None
    """(6,) N, Nm: time-correlated noise, a first-order Gauss-Markov process on each axis; None = white noise only."""
    correlated_time: Array | None = None
    """(6,) s: correlation time of that process; None exactly where ``correlated_std`` is None."""
    correlated_vibration: Array | None = None
    """(6,) share of the vibration noise, 0 to 1, that has the same correlation time; None = none of it."""
    drift_time: Array | None = None
    """(6,) s: time constant with which the drift reverts to zero; None = it never does (report, section 3)."""

    @property
    def in_motion(self) -> MotionNoise | None:
        """Noise that the motion of the joints adds; None = none."""
        return None if self.vibration is None else MotionNoise(self.vibration, self.vibration_speed)

    def at_rest(self) -> Self:
        """The same noise and prior without the noise that motion adds."""
        return self._replace(vibration=None, vibration_speed=None)


class Params(NamedTuple):
    """Parameters of the filter's model; a pytree, differentiable in every leaf."""

    arm: Any
    """What carries the sensor: a ``screws.Arm``, or a ``recorded_pose.FreeBody`` if the sensor's pose is recorded."""
    gravity: Float[Array, " 3"]
    """(3,) m/s^2, base frame, pointing down."""
    theta: Float[Array, " 10"]
    """(10,) inertial parameters of the tool (tool_wrench.py)."""
    joint: JointNoise
    bias: BiasNoise
    effects: Values | None = None
    """Known effects of the catalogue. They may need the whole log: ``pipeline.run`` takes them, ``step`` does not."""


_tool_parameters = keep_program()(tool_parameters)


def params_from_setup(setup: Setup, dtype: Any = None) -> Params:
    """Parameters of the filter as the setup states them.

    Args:
        setup: from ``load_setup``; unstated joint process noise becomes 1 (``params_for_log`` chooses it from the log).
        dtype: of all arrays; None = JAX's default (float32, float64 in x64 mode).

    Raises:
        SetupError: the setup does not state the tool's mass or centre of mass.
    """
    # An unstated tool is guessed only where the reading does not depend on the tool.
    setup = with_noise_as_known(with_guessed_tool(require_tool(setup)))
    sensor, n = setup.sensor, len(setup.robot.screws)
    # The controller may have subtracted the tool's whole wrench, or its weight alone, so that is not in the reading.
    there = {name: float(sensor.compensated != name) for name in ("weight", "tool")}
    of_tool = (np.asarray(x) for x in (setup.tool.mass, setup.tool.center_of_mass, setup.tool.inertia))
    theta = _tool_parameters(*(as_array(x, dtype) for x in of_tool))
    params = Params(
        _sensor_base(setup, dtype),
        there["weight"] * setup.robot.gravity,
        there["tool"] * np.asarray(theta),
        JointNoise(
            np.ones(n) if setup.joints.process_noise_density is None else setup.joints.process_noise_density,
            setup.joints.position_noise_std,
            setup.joints.velocity_noise_std,
            setup.joints.initial_std,
        ),
        BiasNoise(
            setup.bias.noise_density,
            _data_variance(setup, dtype),
            sensor.noise_std**2 + unknown_acceleration(setup),
            np.concatenate([setup.bias.initial, setup.bias.initial_drift]),
            np.concatenate([setup.bias.initial_std, setup.bias.initial_drift_std]),
            correlated_std=sensor.correlated_std,
            correlated_time=sensor.correlated_time,
            drift_time=setup.bias.drift_time,
        ),
    )
    catalogue = catalogue_of_setup(setup)
    stated = values_from_setup(setup.effects, setup.path, catalogue)
    check_observable(setup.effects, setup, partial(SetupError, file=setup.path), "effects.")
    effects, noise = _split_noise(stated, 1 if setup.pose else n, setup.path, catalogue)
    params = params._replace(
        effects=values_of(effects, catalogue) if effects else None, bias=params.bias._replace(**noise)
    )
    return jax.tree.map(partial(as_array, dtype=dtype), params)


def with_noise_as_known(setup: Setup) -> Setup:
    """The setup with its effect ``noise_level``, if any, merged into ``sensor.noise_std`` and removed.

    Quantities that are expressed relative to the sensor's noise, such as the model's error, then use the actual noise.
    """
    if NOISE_LEVEL not in setup.effects:
        return setup
    others = {name: values for name, values in setup.effects.items() if name != NOISE_LEVEL}
    scale = values_from_setup({NOISE_LEVEL: setup.effects[NOISE_LEVEL]}, setup.path)[NOISE_LEVEL]["scale"]
    noise_std = setup.sensor.noise_std * np.asarray(scale)
    return replace(setup, sensor=replace(setup.sensor, noise_std=noise_std), effects=others)


def _split_noise(values: Values, speeds: int, file: str, catalogue: Catalogue) -> tuple[Values, dict[str, Array]]:
    """Split effects into those the filter models as effects, and ``BiasNoise`` fields of those it models as noise.

    Further parameters of a noise effect are omitted where they are infinite, because that is their neutral value.
    """
    noise, others = {}, dict(values)
    for name in values.keys() & catalogue.keys():
        effect = catalogue[name]
        if effect.filter_noise:
            del others[name]
            key, *further = (parameter.name for parameter in effect.parameters)
            rows = values[name][key]
            if len(rows) not in (1, speeds):
                remedy = "give six numbers" + f", or a row of six for each of the {speeds} joints" * (speeds > 1)
                raise SetupError(f"has {len(rows)} rows", file=file, field=f"effects.{name}.{key}", remedy=remedy)
            noise[effect.filter_noise] = np.broadcast_to(rows, (speeds, 6))
            stated = {other: values[name][other] for other in further if other in values[name]}
            noise |= {f"{effect.filter_noise}_{other}": x for other, x in stated.items() if np.isfinite(x).all()}
    return others, noise


def _sensor_base(setup: Setup, dtype: Any) -> Arm | FreeBody:
    """Arm or free body that carries the sensor."""
    robot, sensor = setup.robot, setup.sensor
    if setup.pose is not None:
        return FreeBody(as_array(setup.pose.lever(sensor.translation), dtype), as_array(sensor.rotation, dtype))
    rotation = robot.flange_rotation @ sensor.rotation
    position = robot.flange_translation + robot.flange_rotation @ sensor.translation
    return Arm(*(as_array(x, dtype) for x in (robot.screws[:, :3], robot.screws[:, 3:], position, rotation)))


def _data_variance(setup: Setup, dtype: Any) -> Float[Array, " 36"] | None:
    """(36,) diagonal of Sigma_D, or None for zeros, which saves the computation."""
    noise = setup.data_noise
    if noise is None:
        return None
    if noise.entries is not None:
        return noise.entries**2
    stds = DataNoise(*(as_array(getattr(noise, name), dtype) for name in DataNoise._fields))
    return jax.jit(data_variance)(stds, as_array(setup.robot.gravity, dtype))


def unknown_acceleration(setup: Setup) -> Float[Array, " 6"]:
    """Variance (6,) N^2, Nm^2 of the tool's wrench due to unrecorded accelerations, which are the same in all axes."""
    if setup.pose is None or setup.pose.linear != "none" or setup.sensor.compensated == "tool":
        return np.zeros(6)
    center = setup.tool.center_of_mass
    arm = center @ center - center**2  # squares of the distances of the centre of mass from the axes
    return (setup.tool.mass * setup.pose.acceleration_std) ** 2 * np.concatenate([np.ones(3), arm])


def as_array(x: Any, dtype: Any = None) -> Array:
    """An array of this dtype; None = JAX's default."""
    return jnp.asarray(x, dtype if dtype is not None else jnp.result_type(float))
