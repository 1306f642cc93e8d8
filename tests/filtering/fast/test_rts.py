"""Smoothed states against the one normal distribution of all states and measurements of a log."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.filtering.fast.rts import smooth_track
from ftbias_jax.filtering.fast.scan import Inputs, filter_scan
from ftbias_jax.filtering.process_models import (
    JOINT_MODELS,
    BiasStrength,
    correlated_bias,
    drift_noise,
    matrix,
    reverting_drift,
)

COUNT, LANES, GAP = 16, 2, 9
MODELS = {**JOINT_MODELS, "drift": drift_noise}


@jax.jit
def smooth_all(inputs):
    return {name: smooth_track(model, inputs[name], filter_scan(model, inputs[name])) for name, model in MODELS.items()}


def problem(name, gap=0.1, restart=np.inf, dtype=float):
    """Filters with values of their own in every lane, irregular stamps, measurements missing; two samples coincide."""
    k, m = (2, 1) if name == "drift" else (3, 2)
    rng = np.random.default_rng(0)
    dt = np.r_[0.0, rng.uniform(0.01, 0.1, COUNT - 1)]
    dt[[4, GAP]] = 0.0, gap
    y = rng.normal(size=(COUNT, m, LANES))
    y[rng.uniform(size=y.shape) < 0.3] = np.nan
    y[5] = np.nan
    root = rng.normal(size=(LANES, k, k))
    covariance = np.moveaxis(root @ np.swapaxes(root, 1, 2), 0, -1) + np.eye(k)[:, :, None]
    variance = rng.uniform(0.01, 0.1, y.shape) ** 2
    restarts = np.full((k, LANES), restart)
    values = (dt, rng.uniform(1, 5, LANES), y, variance, rng.normal(size=(k, LANES)), covariance, restarts)
    return Inputs(*(jnp.asarray(x, dtype) for x in values))


def posterior(name, inputs, lane):
    """Means (T, k) and covariances (T, k, k) of the states of one lane, conditioned on everything measured."""
    mean, P = np.asarray(inputs.mean[:, lane]), np.asarray(inputs.covariance[..., lane])
    k, m = len(mean), inputs.y.shape[1]
    means, blocks = [], np.zeros((COUNT, COUNT, k, k))
    for i in range(COUNT):
        A, Q = (np.asarray(matrix(rows)) for rows in MODELS[name](inputs.dt[i], inputs.density[lane]))
        mean, P = A @ mean, A @ P @ A.T + Q
        means.append(mean)
        ahead = P
        for j in range(i, COUNT):
            ahead = ahead if j == i else steps_of(name, inputs, lane, j) @ ahead
            blocks[j, i], blocks[i, j] = ahead, ahead.T
    joint = np.moveaxis(blocks, 2, 1).reshape(COUNT * k, COUNT * k)
    y = np.asarray(inputs.y[..., lane])
    C = np.kron(np.eye(COUNT), np.eye(m, k))[np.isfinite(y).ravel()]
    seen, noise = y[np.isfinite(y)], np.asarray(inputs.variance[..., lane])[np.isfinite(y)]
    gain = np.linalg.solve(C @ joint @ C.T + np.diag(noise), C @ joint).T
    states = np.concatenate(means) + gain @ (seen - C @ np.concatenate(means))
    spread = (joint - gain @ C @ joint).reshape(COUNT, k, COUNT, k)
    return states.reshape(COUNT, k), np.stack([spread[i, :, i] for i in range(COUNT)])


def steps_of(name, inputs, lane, i):
    return np.asarray(matrix(MODELS[name](inputs.dt[i], inputs.density[lane])[0]))


@pytest.fixture(scope="module")
def smoothed():
    return smooth_all({name: problem(name) for name in MODELS})


@pytest.mark.parametrize("name", MODELS)
def test_smoothed_states_are_the_posterior_given_the_whole_log(smoothed, name):
    for lane in range(LANES):
        mean, covariance = posterior(name, problem(name), lane)
        np.testing.assert_allclose(smoothed[name].mean[..., lane], mean, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(smoothed[name].covariance[..., lane], covariance, rtol=1e-9, atol=1e-9)


def test_what_comes_after_a_restart_says_nothing_about_before():
    inputs = {name: problem(name, gap=100.0, restart=50.0) for name in MODELS}
    silent = {name: x._replace(y=x.y.at[GAP:].set(jnp.nan)) for name, x in inputs.items()}
    whole, before = smooth_all(inputs), smooth_all(silent)
    for name in ("integrated_jerk", "integrated_acceleration", "drift"):  # the others' positions are not lost
        np.testing.assert_array_equal(whole[name].mean[:GAP], before[name].mean[:GAP])
        np.testing.assert_array_equal(whole[name].covariance[:GAP], before[name].covariance[:GAP])


def test_covariances_stay_positive_in_single_precision(smoothed):
    single = smooth_all({name: problem(name, dtype=np.float32) for name in MODELS})
    for name, exact in smoothed.items():
        assert single[name].covariance.dtype == np.float32
        covariance = np.moveaxis(np.asarray(single[name].covariance, float), -1, 1)
        assert (np.linalg.eigvalsh(covariance) > 0).all()
        np.testing.assert_allclose(single[name].covariance, exact.covariance, rtol=1e-3, atol=1e-5)
        np.testing.assert_allclose(single[name].mean, exact.mean, rtol=1e-3, atol=1e-3)


def bias_problem(model, dtype=float):
    """Bias filters whose drift reverts; with ``correlated_bias`` in noise whose variance differs between samples."""
    plain = problem("drift", gap=40.0, dtype=dtype)
    rng = np.random.default_rng(1)
    drift_rate, density = rng.uniform(0.1, 2, LANES), rng.uniform(1, 5, LANES)
    if model is reverting_drift:
        strength = BiasStrength(*(jnp.asarray(x, dtype) for x in (density, drift_rate)))
        return plain._replace(density=strength)
    noise_rate, variance = rng.uniform(1, 20, LANES), rng.uniform(0.1, 1, LANES)
    mean, covariance = np.zeros((3, LANES)), np.zeros((3, 3, LANES))
    mean[:2], covariance[:2, :2] = plain.mean, plain.covariance
    # The state is (bias + noise, drift, noise).
    for a in (0, 2):
        for b in (0, 2):
            covariance[a, b] += variance
    strength = BiasStrength(*(jnp.asarray(x, dtype) for x in (density, drift_rate, noise_rate, variance)))
    return plain._replace(
        density=strength,
        mean=jnp.asarray(mean, dtype),
        covariance=jnp.asarray(covariance, dtype),
        restart_variance=jnp.full((3, LANES), jnp.inf, dtype),
    )


def textbook_rts(model, inputs, lane):
    """Means and covariances of one lane by the smoother as textbooks print it, with inverses of predicted matrices."""
    strength = BiasStrength(*(None if x is None else x[lane] for x in inputs.density))
    x, P = np.asarray(inputs.mean[:, lane]), np.asarray(inputs.covariance[..., lane])
    C = np.eye(1, len(x))
    steps = []
    for dt, y, R in zip(inputs.dt, inputs.y[:, 0, lane], inputs.variance[:, 0, lane], strict=True):
        A, Q = (np.asarray(matrix(rows)) for rows in model(dt, strength))
        before = A @ x, A @ P @ A.T + Q
        x, P = before
        if np.isfinite(y):
            K = P @ C.T / (C @ P @ C.T + R)
            x, P = x + K[:, 0] * (y - x[0]), P - K @ C @ P
        steps.append((A, before, x, P))
    kept = [(x, P)]
    for i in reversed(range(COUNT - 1)):
        (A, (ahead, spread), _, _), (_, _, x_i, P_i) = steps[i + 1], steps[i]
        G = P_i @ A.T @ np.linalg.inv(spread)
        x, P = x_i + G @ (x - ahead), P_i + G @ (P - spread) @ G.T
        kept.append((x, P))
    return tuple(np.stack(part) for part in zip(*reversed(kept), strict=True))


@pytest.mark.parametrize("model", [reverting_drift, correlated_bias])
def test_smoothed_biases_in_correlated_noise_are_those_of_the_textbook(model):
    """Through a gap of 40 s, in which the noise and the drift forget all."""
    inputs = bias_problem(model)
    smoothed = jax.jit(lambda inputs: smooth_track(model, inputs, filter_scan(model, inputs)))(inputs)
    single = bias_problem(model, np.float32)
    single = jax.jit(lambda inputs: smooth_track(model, inputs, filter_scan(model, inputs)))(single)
    for lane in range(LANES):
        mean, covariance = textbook_rts(model, inputs, lane)
        np.testing.assert_allclose(smoothed.mean[..., lane], mean, rtol=1e-7, atol=1e-8)
        np.testing.assert_allclose(smoothed.covariance[..., lane], covariance, rtol=1e-7, atol=1e-8)
        np.testing.assert_allclose(single.mean[..., lane], mean, rtol=1e-2, atol=1e-2)
        assert (np.linalg.eigvalsh(np.asarray(single.covariance[..., lane], float)) > -1e-6).all()
