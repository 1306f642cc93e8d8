"""Shared code of the experiments: the demonstration's arm, two kinds of motion, and how results are saved."""

import json
import platform
from functools import partial
from importlib.metadata import version
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.cli.commands import demo
from ftbias_jax.model import simulate
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.model.simulate import Trajectory
from ftbias_jax.model.trajectories import excitation_sines, working_range
from ftbias_jax.setup import parse_setup
from ftbias_jax.types import Sample

jax.config.update("jax_enable_x64", True)

SETUP = parse_setup(demo.SETUP)
CENTER, EXCURSION = working_range(SETUP)
"""(n,) rad: centre of the motions, and their largest excursion from it."""
PARAMS = params_from_setup(SETUP)
TOP_SPEED = 1.5  # rad/s


def sines(seed, t):
    """Trajectory in which every joint moves all the time as a sum of sines of at most 0.2 Hz."""
    return excitation_sines(jax.random.key(seed), t, jnp.array(CENTER), jnp.array(EXCURSION))


def moves(seed, t):
    """Trajectory of minimum-jerk moves between random poses with short stops, as robots are usually programmed."""
    rng, stamps = np.random.default_rng(seed), np.asarray(t)
    here, start = CENTER, 0.0
    q, dq, ddq = (np.zeros((len(stamps), len(here))) for _ in range(3))
    while start <= stamps[-1]:
        there = CENTER + rng.uniform(-1, 1, len(here)) * EXCURSION
        duration = 1.875 * np.abs(there - here).max() / TOP_SPEED
        rows = stamps >= start
        s = np.clip((stamps[rows] - start) / duration, 0, 1)[:, None]
        q[rows] = here + (there - here) * s**3 * (10 - 15 * s + 6 * s**2)
        dq[rows] = (there - here) * 30 * (s * (1 - s)) ** 2 / duration
        ddq[rows] = (there - here) * 60 * s * (1 - s) * (1 - 2 * s) / duration**2
        here, start = there, start + duration + rng.uniform(0.1, 0.6)
    return Trajectory(t, *map(jnp.asarray, (q, dq, ddq)))


MOTIONS = {"sines": sines, "moves": moves}


@partial(jax.jit, static_argnames="count")
def simulate_logs(seed, count, params, trajectories):
    """Simulate logs along a leading axis; return the true signals and the samples that the filter gets."""
    keys = jax.random.split(jax.random.key(seed), count)
    truth = jax.vmap(partial(simulate.simulate, params=params))(keys, trajectory=trajectories)
    dt = jnp.diff(truth.t, axis=1, prepend=truth.t[:, :1])
    return truth, Sample(dt, truth.q, truth.dq, truth.wrench)


def keep(script, result, figure=None, name="result"):
    """Write result.json, with the package versions, and result.png if there is a figure, beside the script."""
    folder = Path(script).parent
    (folder / f"{name}.json").write_text(json.dumps({"versions": versions(), "result": result}, indent=1) + "\n")
    if figure is not None:
        figure.savefig(folder / "result.png", dpi=110)


def versions():
    """Versions of the package, JAX, NumPy and Python, on which the results depend."""
    packages = {name: version(name) for name in ("ftbias-jax", "jax", "numpy")}
    return packages | {"python": platform.python_version()}


def rounded(values, digits=4):
    """Round numbers to significant digits, as nested lists for a small JSON file."""
    return jax.tree.map(lambda x: float(f"{float(x):.{digits}g}"), np.asarray(values).tolist())
