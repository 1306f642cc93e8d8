"""The verb ``plan``: the most informative motion within limits for the requested parameters, and its forecast."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from ftbias_jax.diagnosis.problem import make_problem
from ftbias_jax.errors import UsageError, is_number
from ftbias_jax.filtering.samples import first_position
from ftbias_jax.io import GivenLog, as_logs
from ftbias_jax.io.log import Log
from ftbias_jax.model.effects.types import Effect, EffectValues, Model
from ftbias_jax.model.own_effects import catalogue_of_setup
from ftbias_jax.model.params import Params, params_from_setup
from ftbias_jax.model.trajectories import working_range
from ftbias_jax.planning.asked import NOISE, TOOL, asked_for, inertia_std
from ftbias_jax.planning.checked import excess_at_rest, times, used_shares, within_limits
from ftbias_jax.planning.climb import Task, best_shape, information_of, with_nearest
from ftbias_jax.planning.forecast import forecast, information_of_logs
from ftbias_jax.planning.limits import Limits, check_start, limits_of
from ftbias_jax.planning.noise import noise_of
from ftbias_jax.planning.result import Options, Plan
from ftbias_jax.planning.shape import grid, harmonics_for, motion_at, random_shapes, within
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.runtime.progress import silent
from ftbias_jax.setup import GivenSetup, Setup, as_setup

SHORTEST, LONGEST = 4.0, 300.0
"""s, shortest and longest duration of a plan."""
RATES = (20.0, 10_000.0)
"""Hz, lowest and highest sampling rate."""
STILL = 1e-6
"""Factor that scales a motion down to standing still."""
BINS_A_PERIOD, LEAST_RATE = 10, 25.0
"""Bins of the plan's grid per period of its fastest harmonic, and their lowest rate, Hz."""


@in_float64
def plan(
    setup: GivenSetup,
    to_find: str = TOOL,
    *,
    duration: float = 20.0,
    rate: float = 500.0,
    start: Sequence[float] | None = None,
    logs: GivenLog | Iterable[GivenLog] = (),
    values: Mapping[str, EffectValues] | None = None,
    margin: float = 0.1,
    seed: int = 0,
    own: Sequence[Effect] = (),
    progress: Callable[[str], None] = silent,
) -> Plan:
    """Plan the most informative motion about the tool, an effect, or which of two effects causes a gap.

    It starts and ends at rest in one pose, keeps to the limits of [limits] and of the robot, and is judged with bias
    and drift as nuisance and with the noise model of the filter. Self-collision and obstacles in the cell are not
    considered. Computes in float64 whatever JAX's setting is, and keeps compiled programs in the user's cache folder
    (unless ``FTBIAS_CACHE=off``).

    Args:
        setup: robot, sensor, tool, noise and limits, or its path.
        to_find: "tool" for its mass, centre of mass and inertia; "noise" for that of the readings at rest and what each
            joint's speed adds, where existing logs do not enter the forecast; the name of an effect for its parameters;
            two names joined by a colon to distinguish one from the other.
        duration: s, of the motion.
        rate: samples a second of the log that will be recorded, and of the motion's table.
        start: (n,) rad, the first and last pose; None = that of the first log, or else one in the middle of the robot's
            working range.
        logs: existing logs, or their paths; their information is added to the forecast.
        values: effect -> parameter -> value, of effects that a diagnosis has found; others are planned for at the
            setup's or at typical values.
        margin: share of every limit that is left unused.
        seed: of the random motions from which the search starts.
        own: effects of your own beside those of the catalogue.
        progress: called with the name of each stage as it begins.

    Raises:
        UsageError: an argument is impossible, the first pose is outside of the limits, or no motion determines what is
            asked. SetupError: the setup has no tool, or an effect of it is impossible.
    """
    began = time.monotonic()
    setup, names = as_setup(setup, own), tuple(to_find.split(":"))
    logs = as_logs(logs, setup, raw=True) if logs else []
    check_arguments(setup, names, duration, rate, margin)
    progress("preparing")
    params, catalogue = params_from_setup(setup), catalogue_of_setup(setup)
    stated = {**(params.effects or {}), **(values or {})}
    model = Model(params.arm, params.gravity, params.theta)
    asked = tuple(asked_for(name, model, catalogue, stated) for name in names)
    first = first_pose(setup, logs, start)
    limits, assumed = limits_of(setup, first, margin)
    numbers: tuple[Any, ...] = tuple((one.base, one.scale, one.at) for one in asked)
    if len(asked) == 2:
        numbers = (*((*of_name, of_name[-1]) for of_name in numbers), inertia_std(asked, model, catalogue))
    task, typical = make_task(setup, params, limits, first, numbers, duration, rate)
    check_start(limits, first, setup.robot.joint_names, excess_at_rest(task, catalogue))
    if len(asked) == 2:
        task = with_nearest(task, typical, names, catalogue)
    free = best_shape(task, names, catalogue, seed, lambda share: progress(f"searching, {share // 0.25 / 4:.0%} done"))
    progress("checking the limits")
    found, _ = within(task.points, limits, first, jnp.asarray(free))
    coefficients = within_limits(task, np.asarray(found), duration, catalogue)
    progress("forecasting")
    motion = motion_at(np.arange(round(duration * rate) + 1) / rate, duration, first, coefficients)
    task = task._replace(noise=noise_of(setup, motion.q, motion.dq, rate, task.points.t))
    if len(asked) == 2:
        task = with_nearest(task, coefficients, names, catalogue)
    of_plan = information_of(task, coefficients, names, catalogue)
    of_logs = (
        information_of_logs(make_problem(setup, logs)[0], names, task.numbers) if logs and names != (NOISE,) else None
    )
    of_rest = information_of(task, STILL * coefficients, names, catalogue)
    entries = [catalogue[name] for name in names if name in catalogue]
    expected = forecast(asked, of_plan, of_rest, of_logs, entries)
    checked = motion_at(times(duration), duration, first, coefficients)
    used = used_shares(limits_of(setup, first, 0.0)[0], first, checked)
    chosen = Options(to_find, duration, rate, margin, seed)
    return Plan(
        setup, chosen, asked, motion, coefficients, expected, used, assumed, tuple(logs), time.monotonic() - began
    )


def check_arguments(setup: Setup, names: tuple[str, ...], duration: float, rate: float, margin: float) -> None:
    """Raise an error for arguments for which no plan can be made.

    Raises:
        UsageError: a number is out of range, there are more than two names, a pose is recorded instead of joints, or
            the controller subtracts the tool from the reading.
    """
    if setup.pose is not None:
        raise UsageError("has a recorded pose instead of joints", field="setup", remedy="give a setup with [robot]")
    if len(names) > 2 or len(set(names)) < len(names) or (len(names) == 2 and {TOOL, NOISE} & {*names}):
        remedy = "give 'tool', 'noise', an effect, or two different effects as A:B"
        raise UsageError(f"got {':'.join(names)!r}", field="for", remedy=remedy)
    if names == (TOOL,) and setup.sensor.compensated != "none":
        message = "the controller has subtracted the tool from the reading (sensor.compensated)"
        raise UsageError(message, field="for", remedy="record the raw reading")
    for name, value, least, most in (
        ("duration", duration, SHORTEST, LONGEST),
        ("rate", rate, *RATES),
        ("margin", margin, 0.0, 0.9),
    ):
        if not is_number(value, least, most):
            raise UsageError(f"must be from {least:g} to {most:g}, not {value!r}", field=name)


def first_pose(setup: Setup, logs: Sequence[Log], start: Sequence[float] | None) -> np.ndarray:
    """(n,) rad: the given pose, or the first recorded one, or one in the middle of the robot's working range.

    Raises:
        UsageError: it has another number of joints, or is not finite.
    """
    if start is None:
        return np.asarray(first_position(logs[0].q) if logs else working_range(setup)[0], float)
    pose, n = np.asarray(start, float), len(setup.robot.joint_names)
    if pose.shape != (n,) or not np.isfinite(pose).all():
        raise UsageError(f"has {pose.size} numbers for {n} joints", field="start", remedy="give rad for every joint")
    return pose


def make_task(
    setup: Setup,
    params: Params,
    limits: Limits,
    start: np.ndarray,
    numbers: tuple[Any, ...],
    duration: float,
    rate: float,
) -> tuple[Task, np.ndarray]:
    """Build the task on bins that resolve the fastest harmonic, with the noise of a random motion.

    Also returns the coefficients (n, M) of that motion. It starts at the pose ``start`` (n,) rad and takes ``duration``
    s with ``rate`` log samples each; ``params`` is the setup as arrays, ``numbers`` as in ``Task``.
    """
    harmonics = harmonics_for(limits, duration)
    bins = round(duration * max(LEAST_RATE, BINS_A_PERIOD * harmonics / duration))
    points = grid((np.arange(bins) + 0.5) * duration / bins, duration, harmonics)
    (free,) = random_shapes(0, 1, len(start), harmonics)
    typical = np.asarray(within(points, limits, start, jnp.asarray(free))[0])
    moving = motion_at(np.arange(round(duration * rate)) / rate, duration, start, typical)
    task = Task(
        points=points,
        limits=limits,
        start=start,
        model=Model(params.arm, params.gravity, params.theta),
        known=params.effects or {},
        numbers=numbers,
        noise=noise_of(setup, moving.q, moving.dq, rate, points.t),
    )
    return task, typical
