"""Joint motions to simulate: sums of sines, minimum-jerk moves with dwells, and the joints of a recorded log."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.log import Log
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

SPACING = 0.05
"""s between the knots of a recorded motion's splines."""
FRANKA_CENTER = (0.0, -0.6, 0.0, -2.0, 0.0, 1.8, 0.8)  # rad, a pose with the tool in front of the arm
FRANKA_EXCURSION = (0.8, 0.5, 0.8, 0.5, 1.2, 1.0, 1.5)  # rad, within the joint limits around it
EXCURSION = (0.8, 0.1)  # rad, m: excursion of the joints of any other arm, around zero


class Trajectory(NamedTuple):
    """Joint motion without noise, leading time axis; dq and ddq are the derivatives of q."""

    t: Array
    """(T,) s."""
    q: Array
    """(T, n) rad."""
    dq: Array
    """(T, n) rad/s."""
    ddq: Array
    """(T, n) rad/s^2."""


def working_range(setup: Setup) -> tuple[Array, Array]:
    """Centre and excursion (n,) rad of a sensible motion of the robot."""
    if setup.robot.model.split("_")[0] in ("panda", "fr3"):
        return np.array(FRANKA_CENTER), np.array(FRANKA_EXCURSION)
    revolute = setup.robot.revolute
    excursion = np.where(revolute, *EXCURSION)
    if setup.robot.position_limits is None:
        return np.zeros(len(revolute)), excursion
    lowest, highest = setup.robot.position_limits.T
    excursion = np.minimum(excursion, (highest - lowest) / 2)
    return np.clip(0.0, lowest + excursion, highest - excursion), excursion


@partial(jax.jit, static_argnames="harmonics")  # Without jit, the loop would be compiled again for every log.
def excitation_sines(
    key: Array, t: Array, center: Array, amplitude: Array, harmonics: int = 4, base_frequency: float = 0.05
) -> Trajectory:
    """Sums of sines around a pose, random in phase and weight; every joint moves, velocity and acceleration are exact.

    The amplitude (n,) rad is an upper bound of each joint's excursion from the center (n,) rad; the base frequency, Hz,
    is the lowest one and the others are its multiples.
    """
    weight_key, phase_key = jax.random.split(key)
    n = center.shape[0]
    share = jax.random.exponential(weight_key, (harmonics, n), t.dtype)
    weight = amplitude[None] * share / share.sum(0, keepdims=True)
    phase = jax.random.uniform(phase_key, (harmonics, n), t.dtype, 0, 2 * jnp.pi)
    # Base frequencies differ between joints so that no two joints have the same period.
    omega = 2 * jnp.pi * base_frequency * (1 + 0.07 * jnp.arange(n, dtype=t.dtype))
    angle = omega[None] * t[:, None]
    base_sin, base_cos = jnp.sin(angle), jnp.cos(angle)

    def add_harmonic(carry: tuple[Array, ...], harmonic: tuple[Array, ...]) -> tuple[tuple[Array, ...], None]:
        q, dq, ddq, sin, cos = carry
        speed, in_phase, quadrature = (x[None] for x in harmonic)
        excursion = in_phase * sin + quadrature * cos
        velocity = speed * (in_phase * cos - quadrature * sin)
        # The addition theorem gives the next harmonic ten times more cheaply than its sine and cosine.
        following = (sin * base_cos + cos * base_sin, cos * base_cos - sin * base_sin)
        return (q + excursion, dq + velocity, ddq - speed**2 * excursion, *following), None

    # A loop is used because XLA would recompute an unrolled sum inside every kernel that uses the motion.
    rest = jnp.zeros_like(angle)
    start = (rest + center[None], rest, rest, base_sin, base_cos)
    speeds = (1 + jnp.arange(harmonics, dtype=t.dtype))[:, None] * omega[None]
    (q, dq, ddq, _, _), _ = jax.lax.scan(
        add_harmonic, start, (speeds, weight * jnp.cos(phase), weight * jnp.sin(phase))
    )
    return Trajectory(t, q, dq, ddq)


@jax.jit
def minimum_jerk_moves(
    key: Array, t: Array, center: Array, amplitude: Array, move: float = 3.0, dwell: float = 1.0
) -> Trajectory:
    """Point-to-point moves between random poses with rests in between, as a robot is usually programmed.

    Each move follows 10 s^3 - 15 s^4 + 6 s^5 (Flash and Hogan 1985); all joints start and stop together. A move lasts
    ``move`` s, the rest after it ``dwell`` s; poses are within center +- amplitude, (n,) rad.
    """

    def pose(number: Array) -> Array:
        return center + amplitude * jax.random.uniform(jax.random.fold_in(key, number), center.shape, t.dtype, -1, 1)

    number = jnp.floor(t / (move + dwell)).astype(jnp.int32)
    start, goal = jax.vmap(pose)(number), jax.vmap(pose)(number + 1)
    s = jnp.clip((t - number * (move + dwell)) / move, 0, 1)[:, None]
    path = s**3 * (10 - 15 * s + 6 * s**2)
    speed = 30 * s**2 * (1 - s) ** 2 / move
    acceleration = 60 * s * (1 - s) * (1 - 2 * s) / move**2
    distance = goal - start
    return Trajectory(t, start + path * distance, speed * distance, acceleration * distance)


def replay(log: Log, t: Array | None = None) -> Trajectory:
    """The motion of a recorded log: a quintic spline fitted to each joint's positions by least squares.

    The spline's derivatives are the motion's velocity and acceleration, so the three agree exactly; motion faster than
    the knots resolve, above all encoder noise, is removed. The spline is evaluated at times t (T,) s within the log, or
    at the log's own stamps. Host code in NumPy, float64.

    Raises:
        LogError: a joint has too few positions.
    """
    from scipy.interpolate import make_lsq_spline  # SciPy comes with JAX; only this function needs it

    t = np.asarray(log.t if t is None else t, np.float64)
    derivatives: list[list[Array]] = [[], [], []]
    for joint, positions in enumerate(np.asarray(log.q, np.float64).T):
        known = np.isfinite(positions)
        times = np.asarray(log.t, np.float64)[known]
        if len(times) < 12:
            remedy = "record at least 12 joint positions"
            raise LogError(f"joint {joint + 1} has {len(times)} positions", field="q", remedy=remedy)
        # A knot needs data around it, so the knots are a subset of the stamps and gaps have none.
        bins = np.floor((times - times[0]) / SPACING)
        inner = times[np.flatnonzero(np.diff(bins, prepend=bins[0]))]
        keep = (np.searchsorted(times, inner) >= 6) & (np.searchsorted(times, inner) < len(times) - 6)
        inner = inner[keep][_apart(np.searchsorted(times, inner[keep]))]
        knots = np.concatenate([np.repeat(times[0], 6), inner, np.repeat(times[-1], 6)])
        spline = make_lsq_spline(times, positions[known], knots, k=5)
        inside = np.clip(t, times[0], times[-1])
        for order, values in enumerate(derivatives):
            moving = 1.0 if order == 0 else (t == inside)  # Outside the data the arm stands still.
            values.append(spline(inside, order) * moving)
    return Trajectory(t, *(np.stack(values, -1) for values in derivatives))


def _apart(index: Array, samples: int = 6) -> Array:
    """Positions of the increasing sample numbers to keep so that these are at least ``samples`` apart."""
    kept, last = [], -samples
    for i, value in enumerate(index):
        if value - last >= samples:
            kept.append(i)
            last = value
    return np.array(kept, int)
