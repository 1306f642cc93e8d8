"""The score of held-out blocks, against the Gaussian density of all blocks."""

import numpy as np
import pytest
from made_series import STD, gauss_markov, stamps

from ftbias_jax.calibration.tune_blocks import LogInBlocks, held_out_blocks
from ftbias_jax.filtering.noise.blocks import Blocks
from ftbias_jax.filtering.noise.log_noise import nothing
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.setup import parse_setup

SETUP = parse_setup(
    {
        "robot": {"model": "ur5e"},
        "sensor": {"noise_std": STD.tolist()},
        "tool": {"mass": 1, "center_of_mass": [0, 0, 0]},
    }
)
COUNT, SHARE = 5, 0.6


def with_noise(**values):
    params = params_from_setup(SETUP)
    return params._replace(bias=params.bias._replace(**{name: np.asarray(x) for name, x in values.items()}))


def in_blocks(seconds, slow=0.0):
    rng = np.random.default_rng(0)
    t = stamps(seconds, 4.0)
    y = STD / np.sqrt(COUNT) * rng.normal(size=(len(t), 6)) + gauss_markov(rng, t, slow * STD, 3.0)
    stated = np.broadcast_to(STD**2, y.shape)
    count, number = np.full(y.shape, COUNT), np.asarray(len(t))
    blocks = Blocks(t, y, count, stated, np.zeros((len(t), 1)), stated, 0 * stated, number)
    return LogInBlocks(blocks, nothing())


@pytest.mark.parametrize("louder", [1.0, 2.0])
def test_blocks_are_scored_as_their_joint_density_says(louder):
    """Bias, drift and its random walk as one covariance; held-out blocks given the others are a ratio of densities.

    The scatter of a block, a sum of squares of noise, adds the log density of a Gamma distribution.
    """
    log, before = in_blocks(10.0), with_noise()
    params = before._replace(bias=before.bias._replace(wrench_variance=louder**2 * before.bias.wrench_variance))
    t, y = log.blocks.t, log.blocks.mean
    later = t - t[0]
    first, second = np.meshgrid(later, later)
    sooner, spread = np.minimum(first, second), np.abs(first - second)
    nats = np.zeros(2)
    for i in range(6):
        bias_std, drift_std = np.asarray(params.bias.prior_std)[[i, 6 + i]]
        walk = np.asarray(params.bias.density)[i] ** 2 * (sooner**3 / 3 + sooner**2 * spread / 2)
        covariance = bias_std**2 + drift_std**2 * np.outer(later, later) + walk
        covariance += louder**2 * STD[i] ** 2 / COUNT * np.eye(len(t))
        for k, rows in enumerate((later >= 0, later <= SHARE * later[-1])):
            part = covariance[np.ix_(rows, rows)]
            nats[k] -= (np.linalg.slogdet(part)[1] + y[rows, i] @ np.linalg.solve(part, y[rows, i])) / 2
    unseen = later > SHARE * later[-1]
    variance = louder**2 * STD**2
    of_scatter = -unseen.sum() * (COUNT - 2) / 2 * (np.log(variance) + STD**2 / variance).sum()
    expected = nats[0] - nats[1] + of_scatter
    np.testing.assert_allclose(held_out_blocks(before, [params], [log], SHARE)[1].sum(), expected, rtol=1e-6)


def test_the_slow_error_that_is_there_scores_best():
    log, before = in_blocks(200.0, slow=2.0), with_noise()
    errors = [with_noise(correlated_std=factor * STD, correlated_time=np.full(6, 3.0)) for factor in (2.0, 0.2, 20.0)]
    stated, right, small, large = held_out_blocks(before, errors, [log, log], SHARE).sum(1)
    assert right > max(stated, small, large)
    assert held_out_blocks(before, [], [log], SHARE).sum() == pytest.approx(stated / 2)


def test_noise_that_grows_with_the_motion_scores_best_where_it_is_there():
    """Only the scatter within blocks distinguishes the models, because the means of the blocks are the same."""
    rng = np.random.default_rng(1)
    log = in_blocks(200.0)
    speed = np.abs(np.sin(log.blocks.t))[:, None]
    shaken = STD**2 * (1 + 4 * speed**2)
    scatter = shaken * rng.chisquare(COUNT - 2, shaken.shape) / (COUNT - 2)
    log = log._replace(blocks=log.blocks._replace(scatter=scatter, motion=speed**2))
    tuned = [with_noise(vibration=factor * STD[None] ** 2) for factor in (4.0, 1.0, 16.0)]
    stated, right, less, more = held_out_blocks(with_noise(), tuned, [log], SHARE).sum(1)
    assert right > max(stated, less, more)
