"""Final check of the limits on the motion as it will run: exactly, and at 1 kHz."""

from functools import partial

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.catalogue import Catalogue
from ftbias_jax.model.effects.types import Model, Signals, Values
from ftbias_jax.model.kinematics.arm_batch import arm_motion
from ftbias_jax.planning.climb import Task
from ftbias_jax.planning.limits import Limits, excess, joint_shares
from ftbias_jax.planning.shape import Motion, motion_at
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.types import Array

CHECK_RATE = 1000.0
"""Hz, sampling rate of the check."""
PIECE = 2048
"""Samples evaluated together, so that plans of any length share a compiled program."""
ROUNDING = 1e-9
HALVINGS = 12
"""Bisection steps for the factor that shrinks a motion into the limits of space, to a resolution of 1/4000."""


@keep_program("catalogue")
def _excess(
    limits: Limits, model: Model, known: Values, q: Array, dq: Array, ddq: Array, *, catalogue: Catalogue
) -> Float[Array, " 4"]:
    """(4,) the largest ``limits.excess`` over a piece, whose first sample is the first pose."""
    moving = arm_motion(model.arm, q.T, dq.T, ddq.T)
    zero = jnp.zeros_like(q[:, 0])
    load = compose.predict(Signals(zero, q, dq, ddq, zero, model, motion=moving), known, catalogue)
    return excess(limits, moving, load).max(1)


def largest_excess(task: Task, motion: Motion, catalogue: Catalogue) -> Float[np.ndarray, " 4"]:
    """(4,) largest excess over each of ``limits.SPACE``; 0 or less = kept everywhere, -inf = no limit."""
    limits = task.limits
    stated = (limits.box, limits.floor, limits.keep_cosine, limits.wrench)
    if not any(np.isfinite(x).any() for x in stated):
        return np.full(4, -np.inf)
    found = [np.full(4, -np.inf)]
    rest = np.zeros_like(motion.q[:1])
    for first in range(0, len(motion.t), PIECE - 1):
        rows = np.minimum(np.arange(first, first + PIECE - 1), len(motion.t) - 1)
        ahead = zip((task.start[None], rest, rest), (motion.q, motion.dq, motion.ddq), strict=True)
        piece = [np.concatenate([at_first, x[rows]]) for at_first, x in ahead]
        found.append(np.asarray(_excess(limits, task.model, task.known, *piece, catalogue=catalogue)))
    return np.max(found, 0)


def excess_at_rest(task: Task, catalogue: Catalogue) -> Float[np.ndarray, " 4"]:
    """(4,) excess over each of ``limits.SPACE`` while standing still in the first pose."""
    start = task.start[None]
    return largest_excess(task, Motion(np.zeros(1), start, *[np.zeros_like(start)] * 3), catalogue)


def within_limits(
    task: Task, coefficients: Float[np.ndarray, "n M"], duration: float, catalogue: Catalogue
) -> Float[np.ndarray, "n M"]:
    """Scale coefficients (n, M) joint by joint to the joint limits, then together to the limits of space."""
    at = partial(motion_at, times(duration), duration, task.start)
    scale = (1 - ROUNDING) / np.maximum(shares(task.limits, task.start, at(coefficients)).max(0), ROUNDING)

    def inside(wanted: np.ndarray) -> bool:
        return bool((largest_excess(task, at(wanted), catalogue) <= 0).all())

    largest: np.ndarray = coefficients * scale[:, None]
    fits, fails = (1.0, 1.0) if inside(largest) else (0.0, 1.0)
    for _ in range(HALVINGS if fits < fails else 0):
        middle = (fits + fails) / 2
        fits, fails = (middle, fails) if inside(middle * largest) else (fits, middle)
    largest *= fits
    return largest


def times(duration: float) -> Float[np.ndarray, " T"]:
    """(T,) s at CHECK_RATE, both ends included."""
    return np.linspace(0.0, duration, int(np.ceil(duration * CHECK_RATE)) + 1)


def shares(limits: Limits, start: np.ndarray, motion: Motion) -> Float[np.ndarray, "4 n"]:
    """(4, n) largest share that each joint uses of its travel from the first pose and of its rate limits."""
    moved = np.stack([motion.q - start, motion.dq, motion.ddq, motion.jerk])
    return np.array(joint_shares(limits, start, moved)).max(1)


def used_shares(limits: Limits, start: np.ndarray, motion: Motion) -> Float[np.ndarray, "4 n"]:
    """(4, n) largest shares used, with the position, rad, counted from the middle of the travel; 1 = at its end."""
    found, middle = shares(limits, start, motion), (limits.upper + limits.lower) / 2
    found[0] = (np.abs(motion.q - middle) / (limits.upper - middle)).max(0)
    return found
