"""Noise of joints, bias, sensor and motion by name: which values can be fitted, from where, and how a fit sets them.

All of them are positive, so every fit varies their logarithms (``constrain``), which need no bounds.
"""

from collections.abc import Callable, Mapping, Sequence

import jax.numpy as jnp
import numpy as np

from ftbias_jax.errors import UsageError
from ftbias_jax.filtering.verbs.setup_with import JOINTS
from ftbias_jax.model.params import Params
from ftbias_jax.model.wrench.tool_wrench import DataNoise, data_variance, measurement_covariance
from ftbias_jax.setup.types import DataNoiseSetup, Setup
from ftbias_jax.types import Array

JOINT_NAMES = tuple(JOINTS)
WRENCH_NAMES = ("density", "wrench_std")
KINDS: dict[str, dict[str, str]] = {
    "one": dict.fromkeys(DataNoise._fields, "one"),
    "three": dict.fromkeys(DataNoise._fields, "each"),
    "entries": {"entries": "each"},
}
"""Parametrisations of Sigma_D that can be fitted, as names and ties: four numbers, four per axis, or every entry."""
TIES: dict[str, Callable[[int], np.ndarray]] = {
    "one": lambda size: np.zeros(size, int),
    "pair": lambda size: np.arange(size) * 2 // size,
    "each": lambda size: np.arange(size),
}
"""Group of each lane by number of lanes; lanes of a group share a value: all, the forces and the torques, or none."""
VIBRATION, VIBRATION_SPEED = "vibration", "vibration_speed"
"""Noise that grows with the motion: weights (n, 6) of joint speeds, and the speed (1,) above which growth is linear."""
_KEYS = {name: f"joints.{key}" for name, key in JOINTS.items()} | {
    "density": "bias.noise_density",
    "wrench_std": "sensor.noise_std",
    VIBRATION: f"effects.{VIBRATION}.variance",
    VIBRATION_SPEED: f"effects.{VIBRATION}.speed",
}
LANES = dict.fromkeys(DataNoise._fields, 3) | {"entries": 36}
START_SHARE = {"angular_velocity": 0.01}
"""Share of the sensor's variance that an unstated part of Sigma_D starts with, on the axis where it matters most; else
START_SHARE_OF_OTHERS. Zero has no logarithm, and far below the sensor noise the likelihood is flat. A rate must be off
by about 1 rad/s to be noticeable: started higher, it would absorb what belongs to the accelerations."""
START_SHARE_OF_OTHERS = 0.5


def key_of(name: str) -> str:
    """Key under which a setup states a noise parameter."""
    return _KEYS.get(name, f"data_noise.{name}")


def tied(start: Mapping[str, Array], ties: Mapping[str, str]) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Number the free values of noise parameters, one for each group of entries that are tied together.

    Args:
        start: name -> starting values; a zero has no logarithm and stays zero.
        ties: name -> key of TIES.

    Returns:
        name -> index of the free value of each entry, -1 = it stays zero; and the logarithms (P,) to start from, of the
        geometric means of the entries that are tied together.
    """
    index, logs = dict[str, np.ndarray](), list[float]()
    for name, given in start.items():
        value = np.ravel(np.asarray(given, float))
        group, number = TIES[ties[name]](len(value)), np.full(len(value), -1)
        for g in np.unique(group[value > 0]):
            number[group == g] = len(logs)
            logs.append(float(np.log(value[group == g]).mean()))
        index[name] = number
    return index, np.array(logs)


def starting_values(tools: Sequence[Params], ties: dict[str, str], known: dict[str, Array]) -> dict[str, np.ndarray]:
    """Starting values by name: known ones, else the noise of the first tool, else values that change R noticeably."""
    bias = tools[0].bias
    start = {"density": np.asarray(bias.density), "wrench_std": np.sqrt(np.asarray(bias.wrench_variance))} | known
    for name in ties.keys() & LANES.keys():
        value = np.broadcast_to(np.asarray(known.get(name, 0.0), float), (LANES[name],))
        start[name] = np.where(value > 0, value, _noticed(name, tools))
    return {name: np.asarray(start[name]) for name in ties}


def with_noise(params: Params, noise: Mapping[str, Array]) -> Params:
    """Parameters with values for some of JOINT_NAMES, WRENCH_NAMES and VIBRATION, and for one whole kind of Sigma_D."""
    variance = params.bias.data_variance
    if "entries" in noise:
        variance = noise["entries"] ** 2
    elif noise.keys() >= set(DataNoise._fields):
        variance = data_variance(DataNoise(*(noise[name] for name in DataNoise._fields)), params.gravity)
    bias = params.bias._replace(density=noise.get("density", params.bias.density), data_variance=variance)
    if "wrench_std" in noise:
        bias = bias._replace(wrench_variance=noise["wrench_std"] ** 2)
    if VIBRATION in noise:
        speed = noise[VIBRATION_SPEED][0] if VIBRATION_SPEED in noise else None
        bias = bias._replace(vibration=noise[VIBRATION].reshape(-1, 6), vibration_speed=speed)
    params = params._replace(bias=bias)
    of_joints = {name: noise[name] for name in JOINT_NAMES if name in noise}
    return params._replace(joint=params.joint._replace(**of_joints)) if of_joints else params


def unconstrain(params: Params) -> dict[str, Array]:
    """Logarithms of the noise, by name: unconstrained numbers for an optimiser; ``constrain`` is the inverse.

    Args:
        params: as returned by ``params_for_log``.

    Returns:
        name -> logarithms: ``process_density`` (n,) of rad/s^2.5, ``position_std`` (n,) of rad and ``velocity_std``
        (n,) of rad/s, eta of the joints; ``density`` (6,) of N/s^1.5 and Nm/s^1.5, sigma_Q; ``wrench_std`` (6,) of N
        and Nm, the square root of the diagonal of Sigma_W; and, if the setup states ``[data_noise]``, ``entries`` (36,)
        of m/s^2, rad/s^2 and their like, the square root of the diagonal of Sigma_D. A value of zero has the logarithm
        -inf and no gradient, and stays zero.
    """
    values = {name: getattr(params.joint, name) for name in JOINT_NAMES}
    values |= {"density": params.bias.density, "wrench_std": jnp.sqrt(params.bias.wrench_variance)}
    if params.bias.data_variance is not None:
        values["entries"] = jnp.sqrt(params.bias.data_variance)
    return {name: jnp.log(value) for name, value in values.items()}


def constrain(params: Params, logs: Mapping[str, Array]) -> Params:
    """Parameters with the noise whose logarithms are given; differentiable, the inverse of ``unconstrain``.

    Args:
        params: values of everything else.
        logs: name -> logarithms, (n,) of rad and rad/s, (6,) of N and Nm or (36,), for all or some names that
            ``unconstrain`` returns. The four parts of ``[data_noise]``, (3,) each, may replace ``entries``.

    Raises:
        UsageError: a name that is no noise parameter, or only some of the four parts of ``[data_noise]``.
    """
    known, parts = {*JOINT_NAMES, *WRENCH_NAMES, *LANES}, set(DataNoise._fields)
    if unknown := sorted(set(logs) - known):
        raise UsageError(f"there is no noise {unknown[0]!r}", field="logs", remedy=f"one of {', '.join(sorted(known))}")
    if 0 < len(parts - set(logs)) < len(parts):
        missing = ", ".join(name for name in DataNoise._fields if name not in logs)
        raise UsageError("[data_noise] has four parts", field="logs", remedy=f"give {missing}, too")
    return with_noise(params, {name: jnp.exp(value) for name, value in logs.items()})


def _noticed(name: str, tools: Sequence[Params]) -> float:
    """Value that adds a share of the sensor's variance, on the axis of all tools where it matters most."""
    if name == "entries":
        noise = {name: jnp.ones(36)}
    else:
        noise = {field: jnp.full(3, float(field == name)) for field in DataNoise._fields}
    added = [total_variance(with_noise(params, noise)) / params.bias.wrench_variance - 1 for params in tools]
    most, share = float(np.max(added)), START_SHARE.get(name, START_SHARE_OF_OTHERS)
    return float((share / most) ** (1 / power(name))) if most > 0 else 1.0


def power(name: str) -> float:
    """Exponent of a parameter in the variance it adds: rates enter as products of two, so their exponent is 4."""
    return 4.0 if name == "angular_velocity" else 2.0


def total_variance(params: Params) -> Array:
    """(6,) N^2, Nm^2: diagonal of R."""
    bias = params.bias
    return jnp.diagonal(measurement_covariance(params.theta, bias.data_variance, bias.wrench_variance))


def values_from_setup(setup: Setup) -> dict[str, np.ndarray]:
    """Values of Sigma_D that a setup states, by name."""
    noise = setup.data_noise
    if noise is None:
        return {}
    if noise.entries is not None:
        return {"entries": noise.entries}
    return {name: getattr(noise, name) for name in DataNoise._fields}


def setup_from_values(values: dict[str, np.ndarray]) -> DataNoiseSetup | None:
    """Section ``[data_noise]`` of a setup with fitted values; None if none of them is of Sigma_D."""
    if "entries" in values:
        none = np.zeros(3)
        return DataNoiseSetup(none, none, none, none, values["entries"])
    if DataNoise._fields[0] not in values:
        return None
    return DataNoiseSetup(*(values[name] for name in DataNoise._fields))
