"""``sensor_model.toml``: the sensor's errors as a file, with the sections, keys and units of a setup."""

import os

import numpy as np

from ftbias_jax.errors import SetupError, path_of
from ftbias_jax.model.effects.catalogue import CATALOGUE, values_from_setup
from ftbias_jax.model.effects.types import Values
from ftbias_jax.setup import GivenSetup, as_setup
from ftbias_jax.setup.dump import lines_of, text_of
from ftbias_jax.setup.fields import Section, check_keys, read_toml
from ftbias_jax.setup.parse import parse_setup
from ftbias_jax.setup.types import Setup, sign_of
from ftbias_jax.simulators.sensor_model import EFFECTS, SensorModel

KEYS = {
    "[sensor]": ("noise_std", "reports", "rezeroed", "correlated_std", "correlated_time"),
    "[bias]": ("noise_density", "initial_std", "initial_drift_std", "initial", "initial_drift", "drift_time"),
}
"""Section of a setup -> keys that describe the sensor's own errors."""


def sensor_model(setup: GivenSetup) -> SensorModel:
    """Error model of a setup's sensor: its noise, its bias process, and the setup's effects that are the sensor's own.

    Raises:
        SetupError: an effect has an impossible value.
    """
    setup = as_setup(setup)
    sensor, bias = setup.sensor, setup.bias
    stated = values_from_setup({name: x for name, x in setup.effects.items() if name in EFFECTS}, setup.path)
    values: Values = {
        name: {p.name: np.asarray(stated[name].get(p.name, p.neutral), float) for p in CATALOGUE[name].parameters}
        for name in EFFECTS
        if name in stated
    }
    return SensorModel(
        noise_std=sensor.noise_std,
        density=bias.noise_density,
        initial=np.concatenate([bias.initial, bias.initial_drift]),
        initial_std=np.concatenate([bias.initial_std, bias.initial_drift_std]),
        sign=np.array(sign_of(sensor.reports)),
        tared=np.array(float(sensor.rezeroed)),
        values=values,
        correlated_std=sensor.correlated_std,
        correlated_time=sensor.correlated_time,
        drift_time=bias.drift_time,
    )


def sensor_text(setup: Setup) -> str:
    """Text of ``sensor_model.toml`` for the sensor of a setup."""
    sections = {f"[effects.{name}]" for name in EFFECTS}
    lines = [line for line in lines_of(setup) if line.section in sections or line.key in KEYS.get(line.section, ())]
    return text_of(lines, setup.comments)


def load_sensor_model(path: str | os.PathLike[str]) -> SensorModel:
    """Read a ``sensor_model.toml``, as ``ftbias export`` writes it.

    Raises:
        SetupError: the file cannot be read, is not TOML, or has impossible values.
    """
    file = path_of(path, "sensor model")
    _, mapping = read_toml(file, "give the path of a sensor_model.toml", "give a sensor_model.toml")
    top = check_keys(Section(mapping, "", file), ("sensor", "bias", "effects"))
    setup = parse_setup({**top.values, "sensor_pose": {}}, file)  # a sensor without an arm
    if others := [name for name in setup.effects if name not in EFFECTS]:
        remedy = f"keep those of the sensor: {', '.join(EFFECTS)}"
        raise SetupError("is no effect of the sensor itself", file=file, field=f"effects.{others[0]}", remedy=remedy)
    return sensor_model(setup)
