"""Simulate with an effect, fit its parameters with the bias as a nuisance, compare with the truth: 20 seeds each."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.catalogue import CATALOGUE, complete, neutral_values

SEEDS = 20
SIGMA = np.array([0.05, 0.05, 0.05, 0.003, 0.003, 0.003])

TRUTH = {
    "tool_mass": {"mass": 0.95},
    "tool_com": {"center_of_mass": [0.03, -0.02, 0.08]},
    "tool_inertia": {"inertia": [0.012, 1e-3, 0.0, 0.014, 2e-3, 0.01]},
    "gravity_tilt": {"gravity": [1.3, -2.1, 0.0]},  # the third makes the size right
    "encoder_offset": {"joint": 3.0, "offset": 0.02},
    "tool_flexibility": {
        "frequency": 5.0,
        "damping_ratio": 0.05,
        "share": [0.1, 0.0, 0.0, 0.7, 0.5, 0.0],
        "sagging": 0.6,
    },
    "cable": {
        "stiffness": 15.0,
        "rest_length": 0.3,
        "anchor": [0.3, -0.5, 0.4],
        "link": 0.0,
        "attachment": [0.0, 0.0, 0.05],
    },
    "contact": {"start": [2.0, 6.0], "end": [3.0, 7.5], "force": [[4.0, 1.0, 0.0], [0.0, -3.0, 2.0]]},
    "mount_rotation": {"rotation": [0.02, -0.01, 0.03]},
    "gain": {"gain": [1.02, 0.97, 1.01, 0.95, 1.04, 1.1]},
    "crosstalk": {"matrix": np.eye(6) + 0.02 * np.random.default_rng(1).normal(size=(6, 6)) * (1 - np.eye(6))},
    "hysteresis": {"width": [0.3, 0.2, 0.4, 0.02, 0.03, 0.02]},
    "low_pass": {"cutoff": 4.0},
    "warmup": {"amplitude": [2.0, -1.0, 1.5, 0.1, -0.2, 0.1], "tau": 2.0},
    "temperature_drift": {"per_kelvin": [0.1, -0.2, 0.1, 0.01, 0.0, -0.02], "lag": 0.8},
    "bias_jump": {"time": 4.0, "amplitude": [1.0, -0.5, 0.7, 0.05, 0.1, -0.05]},
    "time_delay": {"delay": 0.03},
}
SELECTING = {"joint", "time", "ramp", "link", "attachment", "point"}
"""Parameters that are held: found by trying each, or geometry that is measured by hand."""


def truth_of(name, model):
    values = {key: jnp.asarray(value) for key, value in TRUTH[name].items()}
    if name == "gravity_tilt":
        size = jnp.linalg.norm(model.gravity)
        values["gravity"] = values["gravity"].at[2].set(-jnp.sqrt(size**2 - (values["gravity"][:2] ** 2).sum()))
    return complete(CATALOGUE[name], values, model)


def free_directions(name, values):
    """(p, ...) for each free parameter: a basis of what may change, scaled to the catalogue's typical sizes."""
    free = {}
    for parameter in CATALOGUE[name].parameters:
        if parameter.name not in SELECTING:
            value = values[parameter.name]
            scale = np.broadcast_to(parameter.scale if np.any(parameter.scale) else 0.1, value.shape)
            which = np.flatnonzero(scale)
            free[parameter.name] = np.eye(value.size)[which].reshape(-1, *value.shape) * scale
    return free


def start_of(name, truth, model):
    """Nothing known where the derivative at zero strength leads on; a few per cent off where a search would lead."""
    neutral = neutral_values(CATALOGUE[name], model, events=2)
    return {
        p.name: truth[p.name] if p.name in SELECTING else 1.03 * truth[p.name] if p.search else neutral[p.name]
        for p in CATALOGUE[name].parameters
    }


def without_line(t, x):
    """x (T, ...) without a constant and a straight line in time: the nuisance of bias and drift."""
    basis = jnp.linalg.qr(jnp.stack([jnp.ones_like(t), t], 1))[0]
    flat = x.reshape(len(t), -1)
    return (flat - basis @ (basis.T @ flat)).reshape(x.shape)


def make_fit(name, signals, wrench, steps=8):
    """A jitted noise (T, 6) -> error of the estimate and its information matrix, both in the catalogue's scales."""
    truth = truth_of(name, signals.model)
    free = free_directions(name, truth)
    sizes = [len(directions) for directions in free.values()]
    start = start_of(name, truth, signals.model)
    sigma = jnp.asarray(SIGMA)[None]

    def moved(from_values, x):
        parts = jnp.split(x, np.cumsum(sizes)[:-1])
        steps = {key: jnp.tensordot(part, free[key], 1) for key, part in zip(free, parts, strict=True)}
        return from_values | {key: from_values[key] + step for key, step in steps.items()}

    def whitened(values):
        if CATALOGUE[name].hook == "model":
            reading = compose.predict(signals, {name: values})
        else:
            reading = compose.read(signals, {name: values}, wrench)
        return without_line(signals.t, reading / sigma).ravel()

    zero = jnp.zeros(sum(sizes))

    def fit(noise):
        data = whitened(truth) + without_line(signals.t, noise).ravel()

        def newton(values, _):
            jacobian = jax.jacfwd(lambda x: whitened(moved(values, x)))(zero)
            return moved(values, jnp.linalg.lstsq(jacobian, data - whitened(values))[0]), None

        values, _ = jax.lax.scan(newton, start, None, length=steps)
        jacobian = jax.jacfwd(lambda x: whitened(moved(values, x)))(zero)
        information = jacobian.T @ jacobian
        error = jnp.concatenate([_coordinates(values[k] - truth[k], free[k]) for k in free])
        return error, information

    return jax.jit(fit), sum(sizes)


def _coordinates(difference, directions):
    flat = directions.reshape(len(directions), -1)
    return flat @ difference.ravel() / (flat**2).sum(1)


QUICK = ("tool_mass", "gain", "time_delay", "bias_jump", "low_pass")


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in TRUTH]
)
def test_the_parameters_come_back_within_their_standard_errors(name, signals, wrench):
    fit, size = make_fit(name, signals, wrench)
    chi2, z = [], []
    for seed in range(SEEDS):
        noise = jax.random.normal(jax.random.key(seed), wrench.shape)
        error, information = (np.asarray(x) for x in fit(noise))
        chi2.append(error @ information @ error)
        identified = np.linalg.eigvalsh(information) > 1e-6 * np.trace(information)
        if identified.all():
            z.append(error / np.sqrt(np.diag(np.linalg.inv(information))))
    freedom = size - (name == "gravity_tilt")  # its size is fixed
    z = np.array(z) if z else np.sqrt(np.array(chi2) / freedom)
    assert (np.abs(z) < 3).mean() > 0.98
    # chi^2 of 20 fits has the mean of its degrees of freedom within four standard errors.
    assert np.mean(chi2) / freedom == pytest.approx(1, abs=4 * np.sqrt(2 / (freedom * SEEDS)))


# The effects on samples are read off the noise, each by the textbook estimator of its parameter.
