"""Mass and centre of mass from readings at rest, with a constant bias and with one that walks."""

import numpy as np
import pytest

from ftbias_jax.calibration.tool import static
from ftbias_jax.setup.rotations import rotation_from_vector, vector_from_rotation

GRAVITY = np.array([0.0, 0.0, -9.81])
MASS, CENTER = 0.9, np.array([0.01, -0.02, 0.06])
NOISE = np.repeat([0.05, 0.002], 3)
BIAS = np.array([3.0, -1.0, 8.0, 0.2, -0.4, 0.1])
FREE = np.concatenate([[10.0], [1.0] * 3, [1e-9] * 6, [np.inf] * 6])


def poses(count=24, seed=0, step=0.0, mounting=None, gravity=GRAVITY):
    """Stated axes of the sensor and its readings; the bias walks in steps of ``step`` times the noise."""
    rng = np.random.default_rng(seed)
    axes = np.stack([rotation_from_vector(rng.uniform(-2, 2, 3)) for _ in range(count)])
    true = axes if mounting is None else axes @ mounting
    s = -np.einsum("nji,j->ni", true, gravity)
    weight = np.concatenate([MASS * s, np.cross(MASS * CENTER, s)], 1)
    walk = step * NOISE * np.cumsum(np.r_[np.zeros((1, 6)), rng.normal(size=(count - 1, 6))], 0)
    return axes, weight - (BIAS + walk) + NOISE * rng.normal(size=(count, 6)), BIAS + walk


def estimate(axes, wrench, prior_std=FREE, drifts=True):
    problem = static.Problem(axes, wrench, np.arange(len(axes), dtype=float), prior_std)
    return static.estimate(problem, 0.5, np.zeros(3), GRAVITY, np.eye(3), drifts)


def errors(found):
    """Errors of mass and first moment, and their stated standard errors."""
    miss = np.r_[found.mass - MASS, found.first_moment - MASS * CENTER]
    return miss, np.sqrt(np.diag(found.covariance)[:4])


def test_a_constant_bias_is_plain_least_squares():
    axes, wrench, _ = poses()
    found = estimate(axes, wrench)
    s = -np.einsum("nji,j->ni", axes, GRAVITY)
    design = np.concatenate([s.reshape(-1, 1), -np.tile(np.eye(3), (len(s), 1))], 1)
    by_hand = np.linalg.lstsq(design, wrench[:, :3].ravel(), rcond=None)[0]
    np.testing.assert_allclose([found.mass, *found.bias[:3]], by_hand, rtol=1e-5)
    assert found.converged
    np.testing.assert_array_equal(found.drift, 0)
    np.testing.assert_allclose(found.noise, np.repeat([0.05, 0.002], 3), rtol=0.25)
    miss, std = errors(found)
    assert (np.abs(miss) < 4 * std).all()
    assert (np.abs(found.bias - BIAS) < 4 * found.bias_std).all()


@pytest.mark.parametrize("step", [0.0, 3.0], ids=["constant", "walking"])
def test_the_error_of_a_pose_left_out_is_that_of_a_fit_without_it(step):
    axes, wrench, _ = poses(step=step)
    found, left = estimate(axes, wrench), 23  # the last pose: without it the walk ends one pose earlier
    design, _ = static._linear(
        static.Problem(axes, wrench, np.arange(24.0), FREE),
        static._Point(found.mass, found.first_moment, np.eye(3), np.eye(3), np.zeros(6)),
        GRAVITY,
    )
    # Naive reference: the joint normal distribution of all readings, with wide priors of the unknowns.
    walk = np.minimum(*np.meshgrid(np.arange(24.0), np.arange(24.0)))
    wide = np.diag(np.r_[[1e2] * 4, [1e-18] * 6, [1e4] * 6])
    rows = np.concatenate(design)
    K = np.kron(walk, np.diag(found.drift**2)) + np.kron(np.eye(24), np.diag(found.noise**2))
    K = K + rows @ wide @ rows.T
    here, rest = np.arange(6) + 6 * left, np.delete(np.arange(144), np.arange(6) + 6 * left)
    predicted = K[np.ix_(here, rest)] @ np.linalg.solve(K[np.ix_(rest, rest)], wrench.ravel()[rest])
    np.testing.assert_allclose(found.left_out[left], wrench[left] - predicted, rtol=1e-3, atol=1e-4)


def test_a_bias_that_walks_is_seen_and_helps():
    """Over many sets the walk is detected, errors are smaller than those of least squares, and error bars hold."""
    z, ours, plain, last = [], [], [], []
    for seed in range(20):
        axes, wrench, bias = poses(seed=seed, step=3.0)
        found = estimate(axes, wrench)
        miss, std = errors(found)
        assert (found.drift > 0).all()
        z.append(miss / std)
        ours.append(miss)
        plain.append(errors(estimate(axes, wrench, drifts=False))[0])
        last.append((found.bias - bias[-1]) / found.bias_std)
    assert (np.square(ours).mean(0) < 0.7 * np.square(plain).mean(0)).all()
    assert np.square(z).mean() < 2
    assert np.square(last).mean() < 2


def test_a_constant_bias_is_rarely_taken_for_a_walk():
    found = [estimate(*poses(seed=seed)[:2]).drift.any() for seed in range(40)]
    assert np.mean(found) < 0.1


def test_one_axis_that_drifts_does_not_cost_the_others():
    z = []
    for seed in range(8):
        axes, wrench, _ = poses(100, seed=seed)
        walk = 0.2 * np.random.default_rng(seed).normal(size=100).cumsum()
        wrench[:, 2] += walk
        found = estimate(axes, wrench)
        assert found.drift[2] > 4 * found.drift[:2].max()
        miss, std = errors(found)
        assert std[0] < 0.6 * errors(estimate(axes, wrench, drifts=False))[1][0]
        z.append(miss / std)
    assert np.square(z).mean() < 2


def test_gains_that_differ_between_axes_are_in_the_error_of_the_mass():
    z, enlarged = [], []
    for seed in range(15):
        axes, wrench, _ = poses(100, seed=seed)
        enlarged.append(estimate(axes, wrench).enlarged)
        wrench[:, :3] *= 1 + 0.02 * np.random.default_rng(seed).normal(size=3)
        found = estimate(axes, wrench)
        z.append((errors(found)[0] / errors(found)[1])[0])
    assert np.mean(np.array(enlarged) > 1) < 0.15
    assert np.mean(np.abs(z) < 3) > 0.85  # the enlargement has two degrees of freedom


def test_turns_of_the_sensor_and_of_gravity_are_found_with_the_tool():
    turn, tilt = rotation_from_vector(np.array([0.1, -0.05, 0.2])), rotation_from_vector(np.array([0.03, -0.02, 0.0]))
    axes, wrench, _ = poses(60, mounting=turn, gravity=tilt @ GRAVITY)
    prior = np.concatenate([[10.0], [1.0] * 3, [0.3] * 3, [0.1] * 3, [np.inf] * 6])
    found = estimate(axes, wrench, prior)
    std = np.sqrt(np.diag(found.covariance))
    assert found.converged
    assert (np.abs(vector_from_rotation(turn.T @ found.rotation)) < 4 * std[4:7]).all()
    assert np.abs(found.gravity - tilt @ GRAVITY).max() < 0.05
    miss, spread = errors(found)
    assert (np.abs(miss) < 4 * spread).all()
    assert (std[4:7] < 0.02).all()
