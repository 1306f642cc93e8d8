"""The best motion: gradient steps on what a plan is asked for, within the limits, from several random starts."""

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
from ftbias_jax.model.kinematics.arm_batch import ArmMotion, arm_motion
from ftbias_jax.model.kinematics.screws import Arm
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
"""Random motions to begin at, and calls of STEPS steps after which only the best go on."""
FINALISTS, CALLS = 2, 20
"""How many of them go on, and for how many calls."""
CLEAR, CLEAR_CALLS = 50.0, 10
"""Standard deviations: two effects that the first steps separate by more need no better motion, and fewer calls."""
STEPS = 20
FASTEST, SLOWEST = 0.05, 0.003
"""Length of a step, rad, at first and at last."""
PENALTIES = 1.0, 1e3
"""Of the squared excess over limits of space and load, its mean and its largest, at first and at last; what is left
over is then scaled away."""
NEAREST_STEPS, NEARER = 8, 0.99
"""At most so many steps to the values nearest to another effect, and the share of the gap that the next must leave."""
PRIOR = 30.0
"""Typical departures: a parameter that no motion shows counts as known this badly."""


class Noise(NamedTuple):
    """What the filter believes of the noise, and of the joints."""

    wrench_variance: Float[Array, " 6"]
    """(6,) N^2, Nm^2 of one sample."""
    joint_covariance: Float[Array, "n 3 3"]
    """(n, 3, 3) of smoothed position, velocity and acceleration."""
    in_motion: MotionNoise | None
    """What the joints' speeds add to one sample; None = nothing."""
    samples: Float[Array, ""]
    """() in each bin of the grid."""
    bias: Nuisance


class Task(NamedTuple):
    """All that the worth of a motion depends on; a pytree."""

    points: Grid
    limits: Limits
    start: Float[Array, " n"]
    """(n,) rad."""
    model: Model
    known: Values
    """Effects that the setup states."""
    numbers: tuple[Any, ...]
    """Of each name that is asked for, all its numbers, and the typical departures and values (P,) of those asked for;
    of two names also the values nearest to the other, and ``asked.inertia_std``."""
    noise: Noise

    @property
    def scale(self) -> Float[Array, " P"]:
        """(P,) typical departures of the last name's."""
        return self.numbers[min(len(self.numbers) - 1, 1)][1]


def signals_of(task: Task, moved: Float[Array, "4 U n"]) -> Signals:
    """What the reading depends on, of a motion (4, U, n) from the start."""
    q, dq, ddq = task.start[None] + moved[0], moved[1], moved[2]
    moving = arm_motion(task.model.arm, q.T, dq.T, ddq.T)
    return Signals(task.points.t, q, dq, ddq, jnp.zeros_like(task.points.t), task.model, motion=moving)


def variance(task: Task, moving: ArmMotion, speed: Float[Array, "U n"]) -> Float[Array, "U 6"]:
    """(U, 6) N^2, Nm^2: noise of the bins' means, with what the joints' uncertainty and speed add to each sample."""
    rotation, jacobian = jnp.moveaxis(moving.sensor_rotation, 2, 0), jacobians(task.model.arm, moving)
    _, gravity, theta = task.model

    def of_joints(R: Array, J: Array) -> Array:
        return jnp.diagonal(covariance_of_joints(joint_sensitivity(theta, R, J, gravity), task.noise.joint_covariance))

    of_sample = task.noise.wrench_variance[None] + jax.vmap(of_joints)(rotation, jacobian)
    if task.noise.in_motion is not None:
        of_sample += task.noise.in_motion.variance(speed)
    return of_sample / task.noise.samples


def jacobians(arm: Arm, moving: ArmMotion) -> Float[Array, "U 6 n"]:
    """(U, 6, n) sensor Jacobians, base frame, of a motion that was worked out before."""
    turned = moving.link_rotation[:, :, :-1]
    angular = jnp.einsum("ijnu,nj->uin", turned, arm.angular)
    linear = jnp.einsum("ijnu,nj->uin", turned, arm.linear)
    lever = moving.link_position[:, :-1] - moving.sensor_position[:, None]
    return jnp.concatenate([linear + jnp.cross(jnp.moveaxis(lever, 2, 0), angular, axis=1), angular], 1)


def products(
    task: Task, moved: Float[Array, "4 U n"], names: tuple[str, ...], catalogue: Catalogue
) -> tuple[Array, Array]:
    """The information (C, C) of the columns that are asked for, and the excess (4, U) over limits of space and load."""
    signals = signals_of(task, moved)
    assert signals.motion is not None
    over = excess(task.limits, signals.motion, compose.predict(signals, task.known, catalogue))
    if names == (NOISE,):
        return noise_information(task, signals.motion, signals.dq), over
    asked = columns(signals, task.known, task.numbers, names, catalogue)
    return information(asked, variance(task, signals.motion, signals.dq), task.noise.bias), over


def noise_information(task: Task, moving: ArmMotion, speed: Float[Array, "U n"]) -> Float[Array, "P P"]:
    """Fisher information of the logarithms of the noise at rest (6,) and of what the joints' speeds add (n,).

    Bias and drift are left out, because they take a few of thousands of samples. A growth that nobody states makes the
    noise of each axis by a half larger while one joint moves at 1 rad/s.
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


def worth(told: Float[Array, "C C"], scale: Float[Array, " P"], names: tuple[str, ...]) -> Float[Array, ""]:
    """What is made small: the mean logarithm of the standard errors, or less the logarithm of what separates two."""
    if len(names) == 1:
        return mean_log_error(told, scale, PRIOR)
    return -jnp.log(jnp.minimum(*separations(told, len(scale))) + 1e-9)


def separations(told: Float[Array, "C C"], second: int) -> list[Array]:
    """nats by which either of two is seen although the other is free, of the products of ``asked.columns``.

    That is the T-optimality of designs that discriminate between models.

    Args:
        told: (C, C) of what the first has beyond the second, the ``second`` derivatives of that, the same the other way
            round, and what the six numbers of the inertia can do.
        second: how many derivatives the second has.
    """
    return [unexplained(told[np.ix_(rows, rows)], 6) for rows in either(len(told), second)]


def either(count: int, second: int) -> list[np.ndarray]:
    """Places of the first's and of the second's columns among all of ``asked.columns``, those of the inertia last."""
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
    """A count of steps of Adam with these lengths (S,), and this penalty on what exceeds limits of space and load.

    Returns:
        the state after them; before the last one the worth with its penalties, and the products (C, C).
    """

    def loss(free: Array) -> tuple[Array, Array]:
        _, moved = within(task.points, task.limits, task.start, free)
        told, over = products(task, moved, names, catalogue)
        beyond = jnp.maximum(over, 0) ** 2
        return worth(told, task.scale, names) + penalty * (beyond.mean() + beyond.max(1).sum()), told

    def step(k: Array, carry: Any) -> Any:
        free, adam, _ = carry
        found, slope = jax.value_and_grad(loss, has_aux=True)(free)
        slope = jnp.where(jnp.isfinite(slope).all(), slope, 0.0)  # where a motion is no motion at all, say
        change, adam = optax.scale_by_adam().update(slope, adam)
        return free - rates[k] * change, adam, found

    nothing = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(loss, state[0]))
    *state, found = jax.lax.fori_loop(0, count, step, (*state, nothing))
    return tuple(state), *found


def told_by(task: Task, coefficients: np.ndarray, names: tuple[str, ...], catalogue: Catalogue) -> np.ndarray:
    """(C, C) ``products`` of the motion with these coefficients (n, M), as it is; by the program of ``climb``."""
    far = np.full(len(task.start), 1e6)  # finite, because no share of a limit may have an infinite derivative
    free = task.limits._replace(lower=-far, upper=far, velocity=far, acceleration=far, jerk=far)
    state = (coefficients, optax.scale_by_adam().init(jnp.asarray(coefficients)))
    told = climb(state, task._replace(limits=free), np.zeros(STEPS), 1, 0.0, names=names, catalogue=catalogue)[2]
    return np.asarray(told)


def with_nearest(task: Task, coefficients: np.ndarray, names: tuple[str, ...], catalogue: Catalogue) -> Task:
    """The task with the values of either of two effects that come nearest to the other, by Gauss-Newton steps."""
    one, two, inertia = task.numbers
    best = tried = [np.asarray(two[3]), np.asarray(one[3])]
    least, steps = [np.inf] * 2, [np.zeros(0)] * 2

    def with_values(second: np.ndarray, first: np.ndarray) -> Task:
        return task._replace(numbers=((*one[:3], first), (*two[:3], second), inertia))

    for _ in range(NEAREST_STEPS):
        told, before = told_by(with_values(*tried), coefficients, names, catalogue), list(least)
        for i, rows in enumerate(either(len(told), len(two[2]))):
            products = told[np.ix_(rows, rows)]
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
    """Numbers (n, M) of the best motion found, for ``shape.within``; ``progress`` gets the share that is done."""
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
