"""Parameters for filtering a log: what the setup states, and estimates from the log for what it leaves open."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ftbias_jax.filtering.fast.scan import Inputs
from ftbias_jax.filtering.joint_filter import first_measured, init
from ftbias_jax.filtering.likelihood import measured_length, nats_in_pieces
from ftbias_jax.filtering.noise.joint_scatter import no_less_than_shown
from ftbias_jax.filtering.pipeline import DEFAULT_OPTIONS, Options, options_from_setup, predict_wrench
from ftbias_jax.filtering.process_models import JOINT_MODELS
from ftbias_jax.filtering.samples import arrays_from_log, first_position, pad, samples_from_log, without_unsettled
from ftbias_jax.io.log import Log
from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.types import Model
from ftbias_jax.model.params import JointNoise, Params, params_from_setup
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array, Sample

LAG_GUARD = 8.0
"""Factor on the joints' process noise, stated or most likely, when filtering. The likelihood weighs noise of the
acceleration and its lag equally, but the bias filter averages noise out and keeps the lag, which varies with the
motion. On simulated logs the bias errors are smallest and the error bars hold around 8 (experiments/joint_noise)."""
MOST_SAMPLES = 1 << 14
"""Number of samples at the start of a log to which the joints' process noise is fitted."""
PIECE, FEW_PIECES = 1 << 13, 4
"""Logs are padded to multiples of PIECE samples; those longer than FEW_PIECES pieces, to multiples of two pieces."""
POINTS, PARTS = 8, 64
"""Points of each grid, and subdivisions of the interval between two points of the fine one: 1 % of the density."""


def params_for_log(setup: Setup, log: Log | Sample, *, guarded: bool = True) -> Params:
    """Parameters to filter a log with, as JAX arrays, for use in your own programs.

    Args:
        setup: robot, sensor, tool and noise.
        log: from ``read_log``, or ``samples_from_log`` of it; a joint process noise that the setup leaves open is the
            most likely one for this log.
        guarded: whether they are for a filter on the robot: the joints' process noise LAG_GUARD times as large, their
            measurement noise as stated. False for ``filter_samples``, which smooths the joints.

    Returns:
        a pytree in JAX's own precision (float32, unless ``jax_enable_x64`` is set).
    """
    samples = samples_from_log(log) if isinstance(log, Log) else log
    options = options_from_setup(setup)
    if not guarded:
        return max_likelihood_params(setup, samples, options)
    return guard_against_lag(_with_process_noise(setup, _stated(setup, samples), samples, options))


def guard_against_lag(params: Params) -> Params:
    """Parameters with the joints' process noise times LAG_GUARD: for filtering, not for smoothing, which has no lag."""
    return params._replace(joint=params.joint._replace(process_density=LAG_GUARD * params.joint.process_density))


def max_likelihood_params(setup: Setup, samples: Sample, options: Options = DEFAULT_OPTIONS) -> Params:
    """Parameters from a setup, with no less measurement noise of the joints than the log shows.

    A process noise of the joints that the setup leaves open is the most likely one for the log.
    """
    params = _stated(setup, samples)
    params = params._replace(joint=no_less_than_shown(params.joint, samples))
    return _with_process_noise(setup, params, samples, options)


def _stated(setup: Setup, samples: Sample) -> Params:
    return zeroed_at(params_from_setup(setup, samples.q.dtype), setup, first_position(samples.q))


def _with_process_noise(setup: Setup, params: Params, samples: Sample, options: Options) -> Params:
    """Parameters with the most likely process noise of the joints, if the setup leaves it open."""
    if setup.joints.process_noise_density is not None:
        return params
    part = jax.tree.map(lambda x: x[:MOST_SAMPLES], samples)
    part = pad(part, padded_length(part.dt.shape[0]))
    likeliest = max_likelihood_density(params.joint, part.dt, part.q, part.dq, model=options.joint_model)
    return params._replace(joint=params.joint._replace(process_density=likeliest))


def zeroed_at(params: Params, setup: Setup, first_q: Float[Array, " n"]) -> Params:
    """Parameters for a log that begins at ``first_q`` (n,) rad, where its sensor may have been set to zero.

    Args:
        params: from ``params_from_setup``, for any log; a joint process noise that the setup leaves open is 1.
        setup: of the log.
        first_q: the first measured position of every joint.
    """
    if not setup.sensor.rezeroed:
        return params
    # If the sensor was set to zero at rest in the first pose, the expected bias includes the tool's wrench there.
    q = jnp.asarray(first_q, params.theta.dtype)
    _, weight = predict_wrench(params, jnp.stack([q, jnp.zeros_like(q), jnp.zeros_like(q)], 1))
    mean = params.bias.prior_mean.at[:6].add(weight)
    return params._replace(bias=params.bias._replace(prior_mean=mean))


@keep_program("model")
def max_likelihood_density(
    noise: JointNoise,
    dt: Float[Array, " T"],
    q: Float[Array, "T n"],
    dq: Float[Array, "T n"],
    *,
    model: str = "integrated_jerk",
) -> Float[Array, " n"]:
    """Maximum-likelihood process noise density of every joint, (n,); noise.process_density is not used.

    How fast a robot's acceleration changes differs by orders of magnitude between motions and is not known in advance.
    The likelihood of one joint has a single broad maximum: a coarse grid is searched, then a fine one between the
    neighbours of its best point, then the polynomial through the points of the fine one.

    Args:
        noise: measurement noise and prior.
        dt: (T,) s.
        q: (T, n) rad, NaN = not measured.
        dq: (T, n) rad/s, NaN = not measured.
        model: key of process_models.JOINT_MODELS.
    """
    grid, fine = jnp.linspace(-8, 12, POINTS, dtype=q.dtype), jnp.linspace(-1, 1, POINTS, dtype=q.dtype)
    fine = fine[:, None] * (grid[1] - grid[0])
    densities = 2 ** jnp.broadcast_to(grid[:, None], (POINTS, q.shape[1]))
    score = _score_densities(noise, dt, q, dq, densities, model)
    middle = grid[jnp.argmax(score, 0)]
    score = _score_densities(noise, dt, q, dq, 2 ** (middle[None] + fine), model)
    best = jnp.argmax(score, 0)
    between = np.linspace(-1, 1, (POINTS - 1) * PARTS + 1)
    weights = np.vander(between, POINTS) @ np.linalg.inv(np.vander(np.linspace(-1, 1, POINTS)))
    far = jnp.abs(jnp.arange(len(between))[:, None] - PARTS * best[None]) > PARTS
    curve = jnp.matmul(jnp.asarray(weights, q.dtype), score - score.max(0)[None], precision="highest")
    place = jnp.asarray(between, q.dtype)[jnp.argmax(jnp.where(far, -jnp.inf, curve), 0)]
    return 2 ** (middle + place * (grid[1] - grid[0]))


def _score_densities(noise: JointNoise, dt: Array, q: Array, dq: Array, densities: Array, model: str) -> Array:
    """Log-likelihood (G, n) of each joint's measurements for each density of its grid (G, n), all in one recursion."""
    start, y = init(noise, first_measured(q)), jnp.stack([q, dq], 1)
    variance = jnp.broadcast_to((jnp.stack([noise.position_std, noise.velocity_std]) ** 2)[None], y.shape)
    restart = jnp.broadcast_to((noise.prior_std**2)[:, None], start.mean.T.shape)
    joints = (y, variance, start.mean.T, jnp.moveaxis(start.covariance, 0, -1), restart)
    lanes = (jnp.concatenate([x] * len(densities), -1) for x in joints)
    inputs, nothing = Inputs(dt, densities.reshape(-1), *lanes), jnp.full((len(dt), 0), jnp.nan)
    length = measured_length(Sample(dt, q, dq, nothing))
    nats = nats_in_pieces(JOINT_MODELS[model], inputs, jnp.ones_like(dt), length)
    return nats.reshape(densities.shape)


def without_useless(log: Log, params: Params) -> Log:
    """The log without readings that the known effects make useless: saturated ones, spikes, repetitions."""
    if params.effects is None:
        return log
    model = Model(params.arm, params.gravity, params.theta)
    return log._replace(wrench=np.asarray(compose.correct_record(jnp.asarray(log.wrench), model, params.effects)))


def useful_samples(log: Log, params: Params) -> Sample:
    """A whole log as NumPy input for a fit, without the readings that the known effects make useless."""
    return without_unsettled(arrays_from_log(without_useless(log, params)), log.t, params)


def rows_of(log: Log, first: int, count: int) -> dict[str, Array]:
    """The arrays (T, ...) of a log, in s, rad, N, Nm, from sample ``first`` on, ``count`` samples or fewer."""
    return {name: getattr(log, name)[first : first + count] for name in ("t", "q", "dq", "wrench", "temperature")}


def padded_length(length: int) -> int:
    """Length to pad to, so that logs of similar length share one program: a power of two, or a multiple of PIECE."""
    largest = PIECE if length <= FEW_PIECES * PIECE else 2 * PIECE
    piece = min(largest, 1 << (length - 1).bit_length())
    return piece * -(-length // piece)
