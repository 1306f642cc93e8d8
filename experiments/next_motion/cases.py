"""Logs of any motion, simulated by MuJoCo, and fits of one effect to them, also to compare two effects."""

import sys
import tomllib
from dataclasses import replace
from itertools import product
from pathlib import Path

import jax.numpy as jnp
import numpy as np

sys.path.append(str(Path(__file__).parents[1]))
import ftbias_jax as ft
from ftbias_jax.diagnosis.hypothesis import at_values, at_zero, movable
from ftbias_jax.diagnosis.problem import make_problem
from ftbias_jax.diagnosis.regression import chain_model
from ftbias_jax.diagnosis.regression.coordinates import can_move
from ftbias_jax.diagnosis.regression.evaluate import measured, readings, whitened
from ftbias_jax.diagnosis.regression.fit import base, fit
from ftbias_jax.model.effects.fitting import SMOOTH
from validation.generator.effects.catalogue import ENTRIES
from validation.generator.effects.effect import Draw, Scene
from validation.generator.effects.slow import bias_path
from validation.generator.nominal_model import random_belief, setup_toml
from validation.generator.recording import Timeline, record
from validation.generator.world import nominal_world, time_grid, wrench

DURATION, RATE = 20.0, 500.0


def make_case(seed):
    """Return a random nominal robot, sensor and tool, with the arm mounted on a table or not, and their setup."""
    belief = replace(random_belief(np.random.default_rng([seed, 0])), reports="wrench_on_tool")
    return belief, ft.parse_setup(tomllib.loads(setup_toml(belief)))


def home_in(setup, belief):
    """Return the setup with position limits within 1.5 rad of the home pose if it has none, and that pose (n,) rad."""
    limits = replace(setup.limits, position_lower=belief.arm.home - 1.5, position_upper=belief.arm.home + 1.5)
    return replace(setup, limits=limits if setup.robot.position_limits is None else setup.limits), belief.arm.home


def wrong_tool(setup, belief):
    """Return the setup with a wrong tool: mass 10 %, centre of mass 4 mm per axis and inertia 20 % too large."""
    tool = replace(
        setup.tool, mass=1.1 * belief.tool.mass, center_of_mass=belief.tool.com + 4e-3, inertia=1.2 * setup.tool.inertia
    )
    return replace(setup, tool=tool)


def make_scene(belief, motion, seed):
    """Return the scene of a motion, t (T,) -> q, dq, ddq (T, n), with its nominal wrench and a random bias."""
    stamps, world, grid = np.arange(round(DURATION * RATE)) / RATE, nominal_world(belief), time_grid(DURATION)
    bias = bias_path(stamps, belief.bias_density, np.random.default_rng([seed, 1]))
    nominal = wrench(world, motion, grid)
    return Scene(belief, motion, DURATION, RATE, stamps, world, grid, nominal, bias, lambda t: 0 * t + 25.0)


def make_log(setup, scene, effects, seed):
    """Record a scene with effects as a log that a user would have."""
    columns, _, _ = record(scene, effects, Timeline(None, True, 0), np.random.SeedSequence([seed, 2]))
    return ft.Log.from_arrays(setup, columns["t"], columns["q"], columns["wrench"], columns["dq"])


def make_effect(name, form, level, scene, seed):
    """Return an effect of the generator; the same seed gives the same size."""
    return ENTRIES[name][0](form, Draw(np.random.default_rng([seed, 3]), level), scene)


def of_plan(made):
    """Convert a planned motion into the function t (T,) -> q, dq, ddq that the generator takes."""
    return lambda t: tuple(made.at(t)[1:4])


def fitted(setup, logs, name):
    """Fit one effect to logs as the diagnosis does; return the problem of the logs and the best fit."""
    problem, _ = make_problem(setup, logs)
    effect = problem.catalogue[name]
    smooth = isinstance(effect.fit.search, SMOOTH)
    if smooth:
        starts = [at_zero(name, movable(problem, effect))]
    else:  # multiple starts over the parameters that determine the form of the effect
        starts = [at_values(problem, effect, **values) for values in starts_of(effect)]
    return problem, max((fit(problem, (start,), base(problem)) for start in starts), key=lambda f: f.log_likelihood)


def starts_of(effect):
    """Starting values for a fit of an effect: all combinations of the ``starts`` of the parameters that a fit can move.

    A parameter that no fit moves, such as the order of a filter, keeps its usual value, as in a plan.
    """
    names = [parameter.name for parameter in effect.parameters if parameter.starts and can_move(parameter).any()]
    return [dict(zip(names, some, strict=True)) for some in product(*(effect.parameter(n).starts for n in names))]


def values_of(problem, found, name):
    """Return the fitted parameters of an effect, in the units of the catalogue."""
    told = chain_model.to_values(problem.parts[0].signals, jnp.asarray(found.z), catalogue=problem.catalogue)
    return {key: np.asarray(value) for key, value in told[name].items()}


def held_out_nats(problem, found):
    """Log-likelihood of another log at the fitted parameters, in nats up to a constant."""
    error = whitened(problem, readings(problem, found.z[None]) - np.nan_to_num(measured(problem))[None])[0]
    return -float((error**2).sum()) / 2
