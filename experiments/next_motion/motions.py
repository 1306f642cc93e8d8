"""The motions that are compared: planned, standard, random, and one of least condition number of the regressor."""

import jax
import jax.numpy as jnp
import numpy as np
import optax

import ftbias_jax as ft
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.model.trajectories import excitation_sines, minimum_jerk_moves
from ftbias_jax.planning import climb, plan
from ftbias_jax.planning.asked import columns
from ftbias_jax.planning.checked import shares, times, within_limits
from ftbias_jax.planning.limits import limits_of
from ftbias_jax.planning.shape import Motion, motion_at, random_shapes, within

DURATION, RATE, MARGIN = 20.0, 500.0, 0.1
RANDOM = 200
STARTS, STEPS = 6, 240
NAMES = ("tool",)


def all_motions(setup, home, span, seed, only=()):
    """Name -> motion t (T,) -> q, dq, ddq (T, n), its expected standard errors (10,), its largest share of a limit."""
    made = ft.plan(setup, "tool", duration=DURATION, rate=RATE, start=home, seed=seed) if not only else None
    key = jax.random.key(seed)
    standard = {
        "sines": lambda t: excitation_sines(key, jnp.asarray(t), jnp.asarray(home), jnp.asarray(span))[1:],
        "moves": lambda t: minimum_jerk_moves(key, jnp.asarray(t), jnp.asarray(home), jnp.asarray(span))[1:],
    }
    if only:
        return {name: (numpy_of(standard[name]), None, None) for name in only}
    (asked,) = made.asked
    limits, _ = limits_of(setup, home, MARGIN)
    numbers = ((asked.base, asked.scale, asked.at),)
    params = params_from_setup(setup)
    task, _ = plan.make_task(setup, params, limits, home, numbers, DURATION, RATE)
    task = task._replace(noise=plan.noise_of(setup, made.motion.q, made.motion.dq, RATE, task.points.t))
    found = {"planned": made.coefficients}
    count = (made.coefficients.shape[1] - 1) // 2
    random = [
        within_limits(task, at_limits(task, free), DURATION, ft.CATALOGUE)
        for free in random_shapes(1000 + seed, RANDOM, len(home), count)
    ]
    worth = [errors(task, one) for one in random]
    found["best of 200 random"] = random[int(np.argmin([np.log(one / asked.scale).mean() for one in worth]))]
    found["condition number"] = within_limits(task, at_limits(task, by_condition(task, seed)), DURATION, ft.CATALOGUE)
    motions = {}
    for name, coefficients in found.items():
        whole = motion_at(times(DURATION), DURATION, home, coefficients)
        motions[name] = (fourier(home, coefficients), errors(task, coefficients), share(setup, home, whole))
    for name, motion in standard.items():
        plain = numpy_of(motion)
        larger = scaled(home, plain, largest_scale(limits, home, plain))
        for label, one in ((name, plain), (f"{name} at the limits", larger)):
            motions[label] = (one, errors_of(task, one), share(setup, home, with_jerk(one)))
    return motions


def fourier(home, coefficients):
    """Convert Fourier coefficients into the function t (T,) -> q, dq, ddq that the generator takes."""
    return lambda t: tuple(motion_at(np.asarray(t), DURATION, home, coefficients)[1:4])


def scaled(home, motion, scale):
    """Return a motion with its excursions from the home pose multiplied by ``scale`` (n,)."""

    def larger(t):
        q, *rates = motion(t)
        return home + scale * (q - home), *(scale * x for x in rates)

    return larger


def numpy_of(motion):
    """Return the motion with NumPy arrays as output."""
    return lambda t: tuple(np.asarray(x) for x in motion(t))


def with_jerk(motion):
    """Sample a motion at 1 kHz, with the jerk by finite differences."""
    t = times(DURATION)
    q, dq, ddq = motion(t)
    return Motion(t, q, dq, ddq, np.gradient(ddq, t, axis=0))


def share(setup, home, motion):
    """Largest share of a joint's stated range, speed, acceleration or jerk that a motion uses."""
    return float(shares(limits_of(setup, home, 0.0)[0], home, motion).max())


def largest_scale(limits, home, motion):
    """Factors (n,) by which joint excursions may be multiplied; moves start elsewhere, so their range is shifted."""
    return (1 - 1e-9) / shares(limits, home, with_jerk(motion)).max(0)


def at_limits(task, free):
    """Map unconstrained numbers to Fourier coefficients within the limits."""
    return np.asarray(within(task.points, task.limits, task.start, jnp.asarray(free))[0])


def errors(task, coefficients):
    """Expected standard errors (10,) of the tool's parameters for a Fourier motion."""
    told = climb.information_of(task, coefficients, NAMES, ft.CATALOGUE)
    return np.sqrt(np.diag(np.linalg.inv(told)))


@jax.jit
def _products(task, moved):
    return climb.products(task, moved, NAMES, ft.CATALOGUE)[0]


def errors_of(task, motion):
    """Expected standard errors (10,) for a motion that is no Fourier series, on the same frequency bins."""
    q, dq, ddq = motion(np.asarray(task.points.t))
    told = _products(task, jnp.stack([q - task.start, dq, ddq, 0 * q]))
    return np.sqrt(np.diag(np.linalg.inv(np.asarray(told))))


@jax.jit
def _climb_condition(state, task, rates):
    """Minimise the log condition number of the regressor of ten parameters and a constant bias by steps of Adam."""

    def loss(free):
        _, moved = within(task.points, task.limits, task.start, free)
        signals = climb.signals_of(task, moved)
        made = columns(signals, task.known, task.numbers, NAMES, ft.CATALOGUE)
        rows = made / jnp.sqrt(task.noise.wrench_variance)[None, None]
        bias = jnp.eye(6)[:, None] * jnp.ones((1, rows.shape[1], 1)) / jnp.sqrt(task.noise.wrench_variance)[None, None]
        flat = jnp.concatenate([rows * task.scale[:, None, None], bias]).reshape(16, -1)
        values = jnp.linalg.eigvalsh(flat @ flat.T)
        return jnp.log(values[-1] / values[0]) / 2

    def step(state, rate):
        free, adam = state
        value, slope = jax.value_and_grad(loss)(free)
        change, adam = optax.scale_by_adam().update(slope, adam)
        return (free - rate * change, adam), value

    return jax.lax.scan(step, state, rates)


def by_condition(task, seed):
    """Minimiser of the condition number (Swevers et al. 1997; FIGAROH), from the first two of the planner's starts."""
    best, least = None, np.inf
    for free in random_shapes(seed, STARTS, len(task.start), (task.points.basis.shape[2] - 1) // 2)[:2]:
        state = (jnp.asarray(free), optax.scale_by_adam().init(jnp.asarray(free)))
        state, values = _climb_condition(state, task, jnp.geomspace(climb.FASTEST, climb.SLOWEST, STEPS))
        if values[-1] < least:
            best, least = state[0], float(values[-1])
    return best
