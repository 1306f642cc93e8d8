"""Joints and bias given the whole log, past and future: the smoother of Rauch, Tung and Striebel (1965).

It smooths many small filters together, over their tracks, without subtracting covariances.

With Q' = A^-1 Q A^-T, the process noise referred to the state before the step, the smoother's gain times A is I - K
with K = Q' (P + Q')^-1, and

    x_smooth = x + (I - K) (A^-1 x_next - x)
    P_smooth = K P K^T + (I - K) (Q' + A^-1 P_next A^-T) (I - K)^T

K is small where the process noise of a step is small, and it is computed as such; textbooks take it as the difference
of two nearly equal matrices. So covariances are sums of squares and accurate in float32 too.
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from ftbias_jax.filtering import joint_filter
from ftbias_jax.filtering.fast.kalman_step import Packed
from ftbias_jax.filtering.fast.scan import Inputs, Smoothed, Track, driven, entries, filter_scan
from ftbias_jax.filtering.fast.stages import add_noise, joint_inputs, joint_states
from ftbias_jax.filtering.pipeline import DEFAULT_OPTIONS, Options, State
from ftbias_jax.filtering.process_models import JOINT_MODELS, ProcessModel, bias_model
from ftbias_jax.model.params import JointNoise, Params
from ftbias_jax.runtime.compiled_loops import compile_forward
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.runtime.lanes import (
    Entry,
    Rows,
    Table,
    Vector,
    congruence,
    dot,
    from_upper,
    plus,
    product,
    times,
    transpose,
    upper,
)
from ftbias_jax.types import Gaussian, Sample


@jax.jit
def smooth_axes(inputs: Inputs) -> tuple[Float[Array, "T 2 6"], Float[Array, "T 2 6"]]:
    """Smoothed bias and drift, from ``stages.bias_inputs``: means and standard deviations (T, 2, 6)."""
    model = bias_model(inputs.density)
    smoothed = smooth_track(model, inputs, filter_scan(model, inputs))
    mean, covariance = add_noise(smoothed.mean, smoothed.covariance, -1)
    return mean[:, :2], jnp.sqrt(jnp.swapaxes(jnp.diagonal(covariance, axis1=1, axis2=2), 1, 2))[:, :2]


@partial(jax.jit, static_argnames="options")
def smooth_joints(params: Params, state: State, samples: Sample, options: Options = DEFAULT_OPTIONS) -> Gaussian:
    """Joint states given the whole log: mean (T, n, 3) and covariance (T, n, 3, 3)."""
    return joint_states(smooth_joint_tracks(params, state, samples, options))


@keep_program("model")
def smoothed_joints(
    noise: JointNoise, dt: Float[Array, " T"], q: Float[Array, "T n"], dq: Float[Array, "T n"], *, model: str
) -> Gaussian:
    """Smoothed joint states by a separate program, which setups share whatever they state about the wrench.

    Args:
        noise: noise model of the joint filter.
        dt: (T,) s since the previous sample.
        q: (T, n) rad, NaN = not measured.
        dq: (T, n) rad/s, NaN = not measured.
        model: key of process_models.JOINT_MODELS.
    """
    start = joint_filter.init(noise, joint_filter.first_measured(q))
    return joint_states(_smooth(model, joint_inputs(noise, start, Sample(dt, q, dq, jnp.full(6, jnp.nan, q.dtype)))))


def smooth_joint_tracks(params: Params, state: State, samples: Sample, options: Options) -> Smoothed:
    """Smoothed joint states with the axes of a track."""
    return _smooth(options.joint_model, joint_inputs(params.joint, state.joint, samples))


def _smooth(name: str, inputs: Inputs) -> Smoothed:
    model = JOINT_MODELS[name]
    return smooth_track(model, inputs, filter_scan(model, inputs))


def smooth_track(model: ProcessModel, inputs: Inputs, track: Track) -> Smoothed:
    """States given all measurements, from the filtered ones that ``scan.filter_scan`` returned for these inputs."""
    k = track.mean.shape[1]
    states = entries(track.mean), upper([entries(track.covariance[:, a]) for a in range(k)])
    last, earlier = jax.tree.map(lambda x: x[-1], states), jax.tree.map(lambda x: x[:-1], states)
    gaps = jax.tree.map(lambda x: x[1:], (inputs.dt[:, None], inputs.drive))
    smoothed = smooth_back(model, inputs.density, list(inputs.restart_variance[:2]), last, (*gaps, earlier))
    mean, triangle = jax.tree.map(lambda x, end: jnp.concatenate([x, end[None]]), smoothed, last)
    return Smoothed(jnp.stack(mean, 1), jnp.stack([jnp.stack(row, 1) for row in from_upper(k, triangle)], 1))


def smooth_back(
    model: ProcessModel, density: Any, restart: Vector, after: Packed, before: tuple[Array, Any, Packed]
) -> Packed:
    """Smoothed states with their entries kept apart, given the smoothed state that follows them.

    ``before`` holds the time (T, 1) s from each state to the next, the inputs that drive the process there, and the
    filtered states (T, B). ``restart`` are the variances of its first two entries from which a filter restarts.
    """
    step_back = _damped_step if isinstance(density, tuple) else _step

    @compile_forward
    def loop(density: Any, restart: Vector, after: Packed, before: Any) -> Packed:
        def body(after: Packed, sample: tuple[Array, Any, Packed]) -> tuple[Packed, Packed]:
            dt_after, drive, (x, triangle) = sample
            k = len(x)
            P, P_after = from_upper(k, triangle), from_upper(k, after[1])
            A, Q = model(dt_after, driven(density, drive))
            ahead = plus(congruence(A, P), Q)
            # A filter that restarted at the next sample has no information from its past.
            apart = (ahead[0][0] > restart[0]) & (ahead[1][1] > restart[1])
            mean, covariance = step_back(A, Q, x, P, after[0], P_after)
            new = mean, upper(covariance)
            smoothed: Packed = jax.tree.map(lambda new, old: jnp.where(apart, old, new), new, (x, triangle))
            return smoothed, smoothed

        return jax.lax.scan(body, after, before, reverse=True)[1]

    return loop(density, restart, after, before)


def _step(A: Table, Q: Table, x: Vector, P: Rows, x_after: Vector, P_after: Rows) -> tuple[Vector, Rows]:
    """One step backward; symbols as in the module's docstring."""
    k = len(x)
    back = _inverse(A)
    noise = congruence(back, Q)
    K = transpose(_solve(plus(P, noise), noise))  # (Q' (P + Q')^-1)^T = (P + Q')^-1 Q'
    keep = [[(1 if a == b else 0) - K[a][b] for b in range(k)] for a in range(k)]
    moved = [new - old for new, old in zip(times(back, x_after), x, strict=True)]
    shift = times(keep, moved)
    spread = plus(noise, congruence(back, P_after))
    return [old + by for old, by in zip(x, shift, strict=True)], plus(congruence(K, P), congruence(keep, spread))


def _damped_step(A: Table, Q: Table, x: Vector, P: Rows, x_after: Vector, P_after: Rows) -> tuple[Vector, Rows]:
    """One step backward where A decays and has no inverse after a gap, with the gain G = P A^T (A P A^T + Q)^-1.

    x_smooth = x + G (x_next - A x),    P_smooth = (I - G A) P (I - G A)^T + G (Q + P_next) G^T
    """
    k = len(x)
    G = transpose(_solve(plus(congruence(A, P), Q), product(A, P)))
    GA = product(G, A)
    keep = [[(1 if a == b else 0) - GA[a][b] for b in range(k)] for a in range(k)]
    moved = [new - old for new, old in zip(x_after, times(A, x), strict=True)]
    shift = times(G, moved)
    return [old + by for old, by in zip(x, shift, strict=True)], plus(
        congruence(keep, P), congruence(G, plus(Q, P_after))
    )


def _inverse(A: Table) -> Table:
    """Inverse of an upper triangular matrix with ones on its diagonal."""
    k = len(A)
    inverse: list[list[Entry]] = [[int(a == b) for b in range(k)] for a in range(k)]
    for b in range(k):
        for a in reversed(range(b)):
            inverse[a][b] = -dot(A[a][a + 1 : b + 1], [inverse[c][b] for c in range(a + 1, b + 1)])
    return inverse


def _solve(S: Rows, right: Rows) -> Rows:
    """S^-1 M for a positive definite S and M = ``right``, by the Cholesky decomposition without square roots."""
    k = len(S)
    lower, pivot = [[S[a][b] for b in range(k)] for a in range(k)], []
    rows = [list(row) for row in right]
    for c in range(k):
        # A pivot is zero where nothing is uncertain and no noise enters; such rows are zero on the right as well.
        pivot.append(jnp.where(lower[c][c] > 0, lower[c][c], 1))
        for a in range(c + 1, k):
            factor = lower[a][c] / pivot[c]
            lower[a] = [entry - factor * top for entry, top in zip(lower[a], lower[c], strict=True)]
            rows[a] = [entry - factor * top for entry, top in zip(rows[a], rows[c], strict=True)]
    for c in reversed(range(k)):
        known = [[lower[c][a] * entry for entry in rows[a]] for a in range(c + 1, k)]
        rows[c] = [(rows[c][b] - sum(row[b] for row in known)) / pivot[c] for b in range(len(rows[c]))]
    return rows
