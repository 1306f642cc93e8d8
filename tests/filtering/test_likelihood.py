"""The likelihood of a log against one big normal distribution, and its gradient against differences."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from ftbias_jax.calibration.tune import stack
from ftbias_jax.errors import UsageError
from ftbias_jax.filtering import likelihood, pipeline
from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.fast.scan import filter_scan
from ftbias_jax.filtering.likelihood import WrenchProblem, log_likelihood, log_likelihood_parts
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.filtering.process_models import JOINT_MODELS, bias_drift_noise
from ftbias_jax.model.kinematics.screws import rotation_from_vector
from ftbias_jax.model.wrench.tool_wrench import covariance_of_joints, joint_sensitivity, measurement_covariance

BURN_IN = 0.1  # s, about ten samples
TURN = jnp.array([0.3, -0.2, 0.5])  # rad; a rotation has three directions to move in, not the nine of its entries


def joint_model(linear_gaussian, params, samples, joint):
    """The filter of one joint as matrices, and its measurements (T, 2)."""
    noise = params.joint
    pairs = jax.vmap(lambda dt: JOINT_MODELS["integrated_jerk"](dt, noise.process_density[joint]))(samples.dt)
    A, Q = (np.moveaxis(np.asarray(rows), -1, 0) for rows in pairs)
    R = np.diag([noise.position_std[joint] ** 2, noise.velocity_std[joint] ** 2])
    start = np.array([samples.q[np.isfinite(samples.q[:, joint]), joint][0], 0, 0])
    model = linear_gaussian(A, Q, np.eye(2, 3), np.tile(R, (len(A), 1, 1)), start, np.diag(noise.prior_std**2))
    return model, np.stack([samples.q, samples.dq], -1)[:, joint]


@partial(jax.jit, static_argnames="kind")
def wrench_models(params, samples, kind):
    """D theta (T, 6) and R (T, 6, 6) at the filtered joint states."""
    inputs = stages.joint_inputs(params, pipeline.init(params, samples), samples)
    joints = stages.joint_states(filter_scan(JOINT_MODELS["integrated_jerk"], inputs))

    def one(mean, covariance):
        motion, wrench_tool = pipeline.predict_wrench(params, mean)
        G = joint_sensitivity(params.theta, motion.R_base_sensor, motion.jacobian, params.gravity)
        R = measurement_covariance(params.theta, params.bias.data_variance, params.bias.wrench_variance)
        return wrench_tool, R + (covariance_of_joints(G, covariance) if kind == "diagonal" else 0)

    return jax.vmap(one)(*joints)


def wrench_model(linear_gaussian, params, samples, kind):
    """The bias filter as matrices, and its measurements (T, 6)."""
    A, Q = map(np.asarray, jax.vmap(bias_drift_noise, in_axes=(0, None))(samples.dt, params.bias.density))
    wrench_tool, R = map(np.asarray, wrench_models(params, samples, kind))
    prior = np.asarray(params.bias.prior_mean), np.diag(params.bias.prior_std**2)
    return linear_gaussian(A, Q, np.eye(6, 12), R, *prior), wrench_tool - np.asarray(samples.wrench)


def density_after(model, y, first):
    """Log density of the measurements from one sample on, given those before."""
    before = model._replace(A=model.A[:first], Q=model.Q[:first], R=model.R[:first])
    return model.log_density(y) - (before.log_density(y[:first]) if first else 0)


@pytest.mark.parametrize("burn_in", [0.0, BURN_IN])
@pytest.mark.parametrize("kind", ["diagonal", "none"])
def test_it_is_the_density_of_the_whole_log(linear_gaussian, params, samples, kind, burn_in):
    first = int((np.cumsum(samples.dt) < burn_in).sum())
    got = log_likelihood_parts(params, samples, Options(joint_uncertainty=kind), burn_in)
    joints = sum(density_after(*joint_model(linear_gaussian, params, samples, j), first) for j in range(3))
    np.testing.assert_allclose(got.joint, joints, rtol=1e-7)
    np.testing.assert_allclose(
        got.wrench, density_after(*wrench_model(linear_gaussian, params, samples, kind), first), rtol=1e-9
    )
    together = log_likelihood(params, samples, Options(joint_uncertainty=kind), burn_in)
    np.testing.assert_allclose(together, got.joint + got.wrench)


def test_the_joints_part_alone(params, samples):
    together = log_likelihood_parts(params, samples, burn_in=BURN_IN).joint
    np.testing.assert_allclose(likelihood.joint_log_likelihood(params, samples, burn_in=BURN_IN), together)


def values_of(params):
    """Everything a fit may change."""
    joint, bias, arm = params.joint, params.bias, params.arm
    return {
        "process density": joint.process_density,
        "encoders": (joint.position_std, joint.velocity_std),
        "sigma_Q": bias.density,
        "Sigma_W": bias.wrench_variance,
        "Sigma_D": bias.data_variance,
        "theta": params.theta,
        "mounting": (arm.zero_position, TURN),
    }


def with_values(params, values):
    position_std, velocity_std = values["encoders"]
    zero_position, turn = values["mounting"]
    zero_rotation = params.arm.zero_rotation @ rotation_from_vector(turn - TURN)
    noise = params.joint._replace(
        process_density=values["process density"], position_std=position_std, velocity_std=velocity_std
    )
    bias = params.bias._replace(
        density=values["sigma_Q"], wrench_variance=values["Sigma_W"], data_variance=values["Sigma_D"]
    )
    arm = params.arm._replace(zero_position=zero_position, zero_rotation=zero_rotation)
    return params._replace(joint=noise, bias=bias, arm=arm, theta=values["theta"])


@pytest.mark.slow
def test_gradient_is_the_limit_of_differences(params, samples):
    flat, unravel = ravel_pytree(values_of(params))

    def score(flat):
        return log_likelihood(with_values(params, unravel(flat)), samples, burn_in=BURN_IN)

    moves = 1e-4 * np.diag(flat)
    points = np.asarray(flat) + np.concatenate([0 * moves[:1], moves, -moves])
    scores, slopes = jax.jit(jax.vmap(jax.value_and_grad(score)))(points)
    high, low = np.split(np.asarray(scores[1:]), 2)
    differences = unravel((high - low) / (2 * np.diag(moves)))
    expected = jax.tree.leaves_with_path(differences)
    for slope, (path, difference) in zip(jax.tree.leaves(unravel(slopes[0])), expected, strict=True):
        scale = np.abs(difference).max()
        np.testing.assert_allclose(slope, difference, rtol=1e-6, atol=1e-6 * scale, err_msg=jax.tree_util.keystr(path))


SECOND = {
    "jvp": lambda f, x: jax.jvp(f, (x,), (x,)),
    "jacfwd": lambda f, x: jax.jacfwd(f)(x),
    "hessian": lambda f, x: jax.hessian(f)(x),
    "compiled hessian": lambda f, x: jax.jit(jax.hessian(f))(x),
    "two reverse passes": lambda f, x: jax.jacrev(jax.grad(f))(x),
}


@pytest.mark.parametrize("derivative", SECOND)
def test_derivatives_that_a_reverse_pass_does_not_have_are_refused_in_words(params, samples, derivative):
    with pytest.raises(UsageError, match=r"neither forwards .* nor twice .*by_steps=True"):
        SECOND[derivative](lambda theta: log_likelihood(params._replace(theta=theta), samples), params.theta)


def test_by_steps_it_is_the_same_and_has_all_derivatives(params, samples):
    def nats(theta, by_steps=True):
        return log_likelihood(params._replace(theta=theta), samples, burn_in=BURN_IN, by_steps=by_steps)

    theta, fast = jnp.asarray(params.theta), jax.jit(jax.value_and_grad(partial(nats, by_steps=False)))
    (value, slope), (along, bend) = jax.jit(lambda x: jax.jvp(jax.value_and_grad(nats), (x,), (x,)))(theta)
    expected, gradient = fast(theta)
    np.testing.assert_allclose(value, expected, rtol=1e-9)
    np.testing.assert_allclose(slope, gradient, rtol=1e-6, atol=1e-9 * np.abs(gradient).max())
    np.testing.assert_allclose(along, gradient @ theta, rtol=1e-6)
    difference = (fast(1.0001 * theta)[1] - fast(0.9999 * theta)[1]) / 2e-4
    np.testing.assert_allclose(bend, difference, rtol=1e-3, atol=1e-3 * np.abs(difference).max())


def test_padded_logs_side_by_side_count_nothing_more(params, samples):
    short = jax.tree.map(lambda x: x[:25], samples)
    both = jax.jit(jax.vmap(lambda log: log_likelihood_parts(params, log)))(stack([samples, short]))
    for i, log in enumerate((samples, short)):
        alone = log_likelihood_parts(params, log)
        np.testing.assert_allclose(both.joint[i], alone.joint, rtol=1e-12)
        np.testing.assert_allclose(both.wrench[i], alone.wrench, rtol=1e-12)


def bias_covariance(problem, axis):
    """Of the measurements of one axis: prior, twice integrated white noise, and R, in closed form."""
    t = np.cumsum(problem.dt)
    early, late = np.minimum(t[:, None], t), np.maximum(t[:, None], t)
    walk = problem.density[axis] ** 2 * (early**2 * late / 2 - early**3 / 6)
    prior = problem.prior_std[axis] ** 2 + problem.prior_std[6 + axis] ** 2 * early * late
    return walk + prior + np.diag(problem.variance[:, axis])


def test_regression_on_whitened_columns_is_generalised_least_squares():
    """With the bias as correlated noise of the measurements, and some measurements missing."""
    rng = np.random.default_rng(0)
    dt = np.r_[0.0, rng.uniform(0.01, 0.1, 29)]
    wrench, columns = rng.normal(size=(30, 6)), rng.normal(size=(3, 30, 6))
    wrench[10:15, 2] = wrench[20] = np.nan
    variance, density, prior_std = rng.uniform(0.1, 1, (30, 6)), rng.uniform(0.5, 2, 6), rng.uniform(0.5, 2, 12)
    problem = WrenchProblem(*map(jnp.asarray, (dt, wrench, variance, density, prior_std)))
    whitened = likelihood.whiten(problem, jnp.asarray(np.concatenate([columns, wrench[None]]))).reshape(4, -1)
    solution, square, *_ = np.linalg.lstsq(whitened[:3].T, whitened[3])

    information, slope, power = np.zeros((3, 3)), np.zeros(3), 0.0
    for axis in range(6):
        seen = np.isfinite(wrench[:, axis])
        X, y = columns[:, seen, axis], wrench[seen, axis]
        weight = np.linalg.inv(bias_covariance(problem, axis)[np.ix_(seen, seen)])
        information, slope, power = information + X @ weight @ X.T, slope + X @ weight @ y, power + y @ weight @ y
    expected = np.linalg.solve(information, slope)
    np.testing.assert_allclose(solution, expected, rtol=1e-9)
    np.testing.assert_allclose(whitened[:3] @ whitened[:3].T, information, rtol=1e-9)
    np.testing.assert_allclose(square, power - slope @ expected, rtol=1e-9)


def test_the_problem_of_the_wrench_is_the_bias_filter_of_the_pipeline(params, samples):
    """With a bias and a drift that are expected from the start."""
    start = pipeline.init(params, samples)
    _, track = stages.run(params, start, samples, pipeline.DEFAULT_OPTIONS)
    problem, wrench_tool = likelihood.wrench_problem(params, samples, stages.joint_states(track.joint))
    np.testing.assert_allclose(wrench_tool, track.wrench_tool, rtol=1e-12)
    whitened = likelihood.whiten(problem, (wrench_tool - problem.wrench)[None])[0]
    np.testing.assert_allclose(whitened**2, track.wrench.nis, rtol=1e-10, atol=1e-12)
