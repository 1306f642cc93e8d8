"""Write parameters back into a setup that states them: the inverse of ``params_for_log``."""

from dataclasses import replace
from typing import Any

import jax
import numpy as np

from ftbias_jax.errors import UsageError
from ftbias_jax.filtering.params_for_log import LAG_GUARD
from ftbias_jax.model.kinematics.recorded_pose import speeds_of
from ftbias_jax.model.params import Params, params_from_setup, unknown_acceleration, with_noise_as_known
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.setup.types import DataNoiseSetup, Setup
from ftbias_jax.types import Array

JOINTS = {
    "process_density": "process_noise_density",
    "position_std": "position_noise_std",
    "velocity_std": "velocity_noise_std",
}
BIAS = {"density": "noise_density", "drift_time": "drift_time"}
SENSOR = {"wrench_variance": "noise_std", "correlated_std": "correlated_std", "correlated_time": "correlated_time"}
"""Field of JointNoise or BiasNoise -> the key that states it, in the section of that name."""
VIBRATION = {"vibration": "variance", "vibration_speed": "speed"}
"""Field of BiasNoise -> the key that states it, under [effects.vibration]."""
NOISE = {*JOINTS, *BIAS, *SENSOR, *VIBRATION, "data_variance"}
ROUND_OFF = 100
"""Numbers that differ by fewer units of the parameters' precision count as equal."""


@in_float64
def setup_with(setup: Setup, params: Params, *, guarded: bool = True) -> Setup:
    """The setup with the noise of some parameters, to be saved; a number that did not change keeps its digits.

    Args:
        setup: from which the parameters were made.
        params: from ``params_for_log``, with other noise of joints, bias, sensor or motion. Sigma_D is written as
            ``data_noise.entries``.
        guarded: whether the joints' process noise is that of a filter, as from ``params_for_log``: ``LAG_GUARD`` times
            what a setup states. False for the noise itself.

    Raises:
        UsageError: noise that is not finite or has another shape, such as that of many logs; or parameters that differ
            from the setup in more than noise, such as in the tool.
    """
    if guarded:
        density = np.asarray(params.joint.process_density, float) / LAG_GUARD
        params = params._replace(joint=params.joint._replace(process_density=density))
    stated = params_from_setup(setup)
    before, after = _fields(stated), _fields(params)
    if setup.sensor.rezeroed:  # ``params_for_log`` added the tool's wrench in the first pose
        after["prior_mean"] = before["prior_mean"]
    precision = ROUND_OFF * float(np.finfo(np.asarray(params.theta).dtype).eps)
    changed = [name for name, was in before.items() if not _same(was, after[name], precision, name in NOISE)]
    for name in changed:
        _require_noise(name, stated, after[name])
    noise: dict[str, Any] = {name: None if after[name] is None else np.asarray(after[name], float) for name in changed}
    variance = noise.get("wrench_variance")
    if variance is not None:  # for poses without accelerations it includes their variance
        noise["wrench_variance"] = np.sqrt(np.maximum(variance - unknown_acceleration(setup), 0))
        setup = with_noise_as_known(setup)  # because that effect would multiply it
    joints, bias, sensor = (
        {key: noise[name] for name, key in keys.items() if name in noise} for keys in (JOINTS, BIAS, SENSOR)
    )
    return replace(
        setup,
        joints=replace(setup.joints, **joints),
        bias=replace(setup.bias, **bias),
        sensor=replace(setup.sensor, **sensor),
        data_noise=_data_noise(noise["data_variance"]) if "data_variance" in noise else setup.data_noise,
        effects=_with_vibration(setup, after) if noise.keys() & VIBRATION.keys() else setup.effects,
    )


def _fields(params: Params) -> dict[str, Any]:
    """All fields of the parameters by name; priors of joints and bias separately."""
    joint, bias = params.joint._asdict(), params.bias._asdict()
    priors = {"joint.prior_std": joint.pop("prior_std"), "bias.prior_std": bias.pop("prior_std")}
    rest = {name: x for name, x in params._asdict().items() if name not in ("joint", "bias")}
    return joint | bias | priors | rest


def _same(one: Any, two: Any, precision: float, by_entry: bool) -> bool:
    """Whether two trees of arrays are equal up to round-off, of every entry or of the largest one of its array."""
    structures: list[Any] = [jax.tree.structure(one), jax.tree.structure(two)]
    if structures[0] != structures[1]:
        return False
    pairs = [(np.asarray(x), np.asarray(y)) for x, y in zip(*map(jax.tree.leaves, (one, two)), strict=True)]
    return all(
        x.shape == y.shape
        and np.allclose(y, x, rtol=precision, atol=0 if by_entry else precision * np.abs(x).max(initial=0))
        for x, y in pairs
    )


def _require_noise(name: str, stated: Params, value: Any) -> None:
    """Refuse values that cannot be noise of this setup."""
    if name not in NOISE:
        remedy = "setup_with writes noise alone; change the setup itself, such as setup.tool, and make params of it"
        raise UsageError("is not what the setup states", field=f"params.{name}", remedy=remedy)
    if value is None:
        return
    joints = len(stated.joint.process_density)
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys(JOINTS, (joints,))
    speeds = speeds_of(stated.arm, np.zeros(joints))  # a recorded pose has only one
    shapes |= {"data_variance": (36,), "vibration": (len(speeds), 6), "vibration_speed": ()}
    if (shape := np.shape(value)) != (wanted := shapes.get(name, (6,))):
        remedy = "give the parameters of one setup, not those of each log"
        raise UsageError(f"has shape {shape} instead of {wanted}", field=f"params.{name}", remedy=remedy)
    if not np.isfinite(value).all() or np.min(value) < 0:
        remedy = "the fit that made it diverged: start nearer, or take smaller steps"
        raise UsageError(f"has {np.asarray(value).ravel()}", field=f"params.{name}", remedy=remedy)


def _data_noise(variance: Array | None) -> DataNoiseSetup | None:
    if variance is None:
        return None
    none = np.zeros(3)
    return DataNoiseSetup(none, none, none, none, np.sqrt(variance))


def _with_vibration(setup: Setup, fields: dict[str, Any]) -> dict[str, Any]:
    """The effects of the setup with the noise that grows with the motion."""
    stated = {key: x for name, key in VIBRATION.items() if (x := fields[name]) is not None}
    values = {"vibration": {key: np.asarray(x, float).tolist() for key, x in stated.items()}}
    others = {name: x for name, x in setup.effects.items() if name != "vibration"}
    return others if fields["vibration"] is None else others | values
