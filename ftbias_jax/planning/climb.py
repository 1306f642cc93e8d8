"""Search for the best motion: gradient steps on the design criterion, within limits, from several random starts."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Float

from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.catalogue import Catalogue
from ftbias_jax.model.effects.types import Model, Signals, Values
from ftbias_jax.model.kinematics.arm_batch import ArmMotion, arm_motion, jacobians
from ftbias_jax.model.motion_noise import MotionNoise
from ftbias_jax.model.wrench.tool_wrench import covariance_of_joints, joint_sensitivity
from ftbias_jax.planning.asked import NOISE, columns
from ftbias_jax.planning.information import Nuisance, information, mean_log_error, unexplained
from ftbias_jax.planning.limits import Limits, excess
from ftbias_jax.planning.shape import Grid, random_shapes, within
from ftbias_jax.runtime.jax_config import same_precision
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.types import Array

STARTS, FEW_STEPS = 6, 1
"""Number of random starting motions, and calls of STEPS steps after which only the best continue."""
FINALISTS, CALLS = 2, 20
"""Number of starts that continue, and calls for each of them."""
CLEAR, CLEAR_CALLS = 50.0, 10
"""Standard deviations of separation of two effects after the first steps above which this many calls suffice."""
STEPS = 20
FASTEST, SLOWEST = 0.05, 0.003
"""Length of a step, rad, at the start and at the end."""
PENALTIES = 1.0, 1e3
"""Weight, at the start and at the end, of the squared excess (mean plus maximum) over limits of space and load; any
remaining excess is then removed by scaling."""
NEAREST_STEPS, NEARER = 8, 0.99
"""Most steps to the values closest to another effect, and share of the gap above which a step ends the search."""
PRIOR = 30.0
"""Prior standard deviation, in typical departures, of a parameter that no motion constrains."""


class Noise(NamedTuple):
    """Noise of the wrench, the joints and the bias, as modelled by the filter."""

    wrench_variance: Float[Array, " 6"]
    """(6,) N^2, Nm^2, variance of one sample."""
    joint_covariance: Float[Array, "n 3 3"]
    """(n, 3, 3) covariance of smoothed position, velocity and acceleration."""
    in_motion: MotionNoise | None
    """Noise that the joints' speeds add to one sample; None = none."""
    samples: Float[Array, ""]
    """() number of samples per bin of the grid."""
    bias: Nuisance


class Task(NamedTuple):
    """All inputs of the design criterion of a motion; a pytree."""

    points: Grid
    limits: Limits
    start: Float[Array, " n"]
    """(n,) rad, first pose."""
    model: Model
    known: Values
    """Effects that the setup states."""
    numbers: tuple[Any, ...]
    """For each requested name, all its numbers, and the typical departures and values (P,) of the requested ones; for
    two names also the values closest to the other one, and ``asked.inertia_std``."""
    noise: Noise

    @property
    def scale(self) -> Float[Array, " P"]:
        """(P,) typical departures of the last name's parameters."""
        return self.numbers[min(len(self.numbers) - 1, 1)][1]


def signals_of(task: Task, moved: Float[Array, "4 U n"]) -> Signals:
    """Signals of a motion (4, U, n) relative to the start, from which the reading is predicted."""
    q, dq, ddq = task.start[None] + moved[0], moved[1], moved[2]
    moving = arm_motion(task.model.arm, q.T, dq.T, ddq.T)
    return Signals(task.points.t, q, dq, ddq, jnp.zeros_like(task.points.t), task.model, motion=moving)


def variance(task: Task, moving: ArmMotion, speed: Float[Array, "U n"]) -> Float[Array, "U 6"]:
    """(U, 6) N^2, Nm^2: noise variance of the bin means, including joint uncertainty and the noise added by speed."""
    rotation, jacobian = jnp.moveaxis(moving.sensor_rotation, 2, 0), jacobians(task.model.arm, moving)
    _, gravity, theta = task.model

    def of_joints(R: Array, J: Array) -> Array:
        return jnp.diagonal(covariance_of_joints(joint_sensitivity(theta, R, J, gravity), task.noise.joint_covariance))

    of_sample = task.noise.wrench_variance[None] + jax.vmap(of_joints)(rotation, jacobian)
    if task.noise.in_motion is not None:
        of_sample += task.noise.in_motion.variance(speed)
    return of_sample / task.noise.samples


def products(
    task: Task, moved: Float[Array, "4 U n"], names: tuple[str, ...], catalogue: Catalogue
) -> tuple[Array, Array]:
    """Information (C, C) of the requested columns, and the excess (4, U) over limits of space and load."""
    signals = signals_of(task, moved)
    assert signals.motion is not None
    over = excess(task.limits, signals.motion, compose.predict(signals, task.known, catalogue))
    if names == (NOISE,):
        return noise_information(task, signals.motion, signals.dq), over
    asked = columns(signals, task.known, task.numbers, names, catalogue)
    return information(asked, variance(task, signals.motion, signals.dq), task.noise.bias), over


def noise_information(task: Task, moving: ArmMotion, speed: Float[Array, "U n"]) -> Float[Array, "P P"]:
    """Fisher information of the logarithms of the noise at rest (6,) and of the noise that joint speeds add (n,).

    Bias and drift are neglected, because they take only a few of thousands of degrees of freedom. If no growth with
    speed is stated, the noise of each axis is assumed to be larger by a half while one joint moves at 1 rad/s.
    """
    noise, joints = task.noise, speed.shape[1]
    rest, growth = noise.wrench_variance, noise.in_motion or MotionNoise(1.25 * noise.wrench_variance[None])
    rows = jnp.broadcast_to(growth.per_speed, (joints, 6))

    def logarithm(x: Array) -> Array:
        more = growth._replace(per_speed=rows * jnp.exp(2 * x[6:, None]))
        scaled = noise._replace(wrench_variance=rest * jnp.exp(2 * x[:6]), in_motion=more)
        return jnp.log(variance(task._replace(noise=scaled), moving, speed))

    slopes = jax.jacfwd(logarithm)(jnp.zeros(6 + joints))
    return noise.samples / 2 * jnp.einsum("uap,uaq->pq", slopes, slopes)


def worth(information: Float[Array, "C C"], scale: Float[Array, " P"], names: tuple[str, ...]) -> Float[Array, ""]:
    """Objective to minimise: the mean log standard error, or minus the logarithm of the separation of two effects."""
    if len(names) == 1:
        return mean_log_error(information, scale, PRIOR)
    return -jnp.log(jnp.minimum(*separations(information, len(scale))) + 1e-9)


def separations(information: Float[Array, "C C"], second: int) -> list[Array]:
    """nats by which each of two effects is separated from the other one with free parameters.

    This is the criterion of T-optimal designs for model discrimination.

    Args:
        information: (C, C) products of ``asked.columns``: the first's difference from the second, ``second``
            derivatives of the second, the same with the roles exchanged, and the six changes due to the inertia.
        second: number of derivatives of the second effect.
    """
    return [unexplained(information[np.ix_(rows, rows)], 6) for rows in either(len(information), second)]


def either(count: int, second: int) -> list[np.ndarray]:
    """Indices of the first's and the second's columns in ``asked.columns``, each followed by those of the inertia."""
    one, two, inertia = np.split(np.arange(count), [second + 1, count - 6])
    return [np.concatenate([one, inertia]), np.concatenate([two, inertia])]


@keep_program("names", "catalogue")
def climb(
    state: Any,
    task: Task,
    rates: Float[Array, " S"],
    count: int,
    penalty: float,
    *,
    names: tuple[str, ...],
    catalogue: Catalogue,
) -> Any:
    """Take ``count`` steps of Adam with these lengths (S,) and this penalty on excess over limits of space and load.

    Returns:
        the state after the steps; the penalised objective and the products (C, C), both before the last step.
    """

    def loss(free: Array) -> tuple[Array, Array]:
        _, moved = within(task.points, task.limits, task.start, free)
        information, over = products(task, moved, names, catalogue)
        beyond = jnp.maximum(over, 0) ** 2
        return worth(information, task.scale, names) + penalty * (beyond.mean() + beyond.max(1).sum()), information

    def step(k: Array, carry: Any) -> Any:
        free, adam, _ = carry
        found, slope = jax.value_and_grad(loss, has_aux=True)(free)
        slope = jnp.where(jnp.isfinite(slope).all(), slope, 0.0)  # for example where nothing moves
        change, adam = optax.scale_by_adam().update(slope, adam)
        return free - rates[k] * change, adam, found

    nothing = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(loss, state[0]))
    *state, found = jax.lax.fori_loop(0, count, step, (*state, nothing))
    return tuple(state), *found


def information_of(task: Task, coefficients: np.ndarray, names: tuple[str, ...], catalogue: Catalogue) -> np.ndarray:
    """(C, C) ``products`` of the unscaled motion with these coefficients (n, M), by the program of ``climb``."""
    far = np.full(len(task.start), 1e6)  # finite, because no share of a limit may have an infinite derivative
    free = task.limits._replace(lower=-far, upper=far, velocity=far, acceleration=far, jerk=far)
    state = (coefficients, optax.scale_by_adam().init(jnp.asarray(coefficients)))
    information = climb(state, task._replace(limits=free), np.zeros(STEPS), 1, 0.0, names=names, catalogue=catalogue)[2]
    return np.asarray(information)


def with_nearest(task: Task, coefficients: np.ndarray, names: tuple[str, ...], catalogue: Catalogue) -> Task:
    """Return the task with those values of each of two effects that are closest to the other, by Gauss-Newton."""
    one, two, inertia = task.numbers
    best = tried = [np.asarray(two[3]), np.asarray(one[3])]
    least, steps = [np.inf] * 2, [np.zeros(0)] * 2

    def with_values(second: np.ndarray, first: np.ndarray) -> Task:
        return task._replace(numbers=((*one[:3], first), (*two[:3], second), inertia))

    for _ in range(NEAREST_STEPS):
        information, before = information_of(with_values(*tried), coefficients, names, catalogue), list(least)
        for i, rows in enumerate(either(len(information), len(two[2]))):
            products = information[np.ix_(rows, rows)]
            if products[0, 0] < least[i]:
                least[i], best[i], size = products[0, 0], tried[i], len(tried[i])
                normal = products[1:, 1:] + np.diag(np.repeat([0.0, 1.0], [size, 6]))
                unit = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-30))
                solved = np.linalg.lstsq(normal * unit[:, None] * unit, products[1:, 0] * unit, 1e-9)[0] * unit
                steps[i] = solved[:size]
            else:
                steps[i] = steps[i] / 4
        tried = [x + step for x, step in zip(best, steps, strict=True)]
        if all(NEARER * last < now < last for last, now in zip(before, least, strict=True)):
            break
    return with_values(*best)


def best_shape(
    task: Task, names: tuple[str, ...], catalogue: Catalogue, seed: int, progress: Callable[[float], None]
) -> np.ndarray:
    """Return the numbers (n, M) of the best motion found, for ``shape.within``; ``progress`` gets the share done."""
    count, size = task.points.basis.shape[2], len(task.start)
    starts = random_shapes(seed, STARTS, size, (count - 1) // 2)
    total, done = STARTS * FEW_STEPS + FINALISTS * CALLS, 0
    states = [(free, optax.scale_by_adam().init(jnp.asarray(free))) for free in starts]
    values = [np.inf] * STARTS

    def advance(i: int, calls: int, slowest: float) -> None:
        nonlocal done
        rates = np.geomspace(FASTEST, slowest, calls * STEPS).reshape(calls, STEPS)
        for few, penalty in zip(rates, np.geomspace(*PENALTIES, calls), strict=True):
            states[i], value, _ = climb(states[i], task, few, STEPS, penalty, names=names, catalogue=catalogue)
            values[i], done = float(np.nan_to_num(value, nan=np.inf)), done + 1
            progress(done / total)

    with ThreadPoolExecutor() as pool:
        list(pool.map(same_precision(partial(advance, calls=FEW_STEPS, slowest=FASTEST)), range(STARTS)))
        finalists = np.argsort(values)[:FINALISTS].tolist()
        calls = CLEAR_CALLS if len(names) == 2 and min(values) < -np.log(CLEAR**2 / 2) else CALLS
        total = done + FINALISTS * calls
        list(pool.map(same_precision(partial(advance, calls=calls, slowest=SLOWEST)), finalists))
    best = min(finalists, key=lambda i: values[i])
    return np.asarray(states[best][0])
