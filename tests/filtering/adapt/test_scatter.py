"""The compiled fit of a variance against the same steps in a few lines of numpy."""

import numpy as np
import pytest

from ftbias_jax.filtering.adapt.scatter import HEAVY, LEAST_LEVEL, Scatter, log_likelihood, maximise, variance_of

COUNT, ROUNDS = 70, 40


def data_of(parts):
    rng = np.random.default_rng(0)
    stated = tuple(rng.uniform(0.5, 2, (COUNT, 6)) for _ in range(parts))
    dof = rng.integers(0, 20, (COUNT, 6)).astype(float)
    dof[:, 4] = 0  # an axis that nobody measured
    value = rng.gamma(3, 0.5, (COUNT, 6))
    value[5] *= 100  # a spike
    return Scatter(value, dof, stated)


def by_numpy(data, motion):
    """Shares (K, 6) and growths (n, 6), as the head of the module says."""
    columns = [*data.stated, *motion.T[:, :, None]]
    pairs = zip(data.value.T, data.dof.T, strict=True)
    usual = np.array([np.median(x[there > 0]) if (there > 0).any() else 1.0 for x, there in pairs])
    scale = [sum(data.stated).mean(0)] * len(data.stated) + [max(1, motion.shape[1]) * x.mean() for x in motion.T]
    at = [usual / x / 2 for x in scale]
    for _ in range(ROUNDS):
        mu = np.maximum(sum(b * x for b, x in zip(at, columns, strict=True)), LEAST_LEVEL * 1e-3 * sum(data.stated))
        down = data.dof / mu
        up = down * np.minimum(data.value / mu, HEAVY)  # of a spike a part counts
        with np.errstate(invalid="ignore"):
            at = [b * np.sqrt((x * up).sum(0) / (x * down).sum(0)) for b, x in zip(at, columns, strict=True)]
    count = len(data.stated)
    return np.array(at[:count]), np.array(at[count:]).reshape(-1, 6)


@pytest.mark.parametrize(("parts", "joints"), [(1, 0), (2, 3)])
def test_steps_are_those_of_numpy(parts, joints):
    data = data_of(parts)
    motion = np.random.default_rng(1).uniform(0.5, 3, (COUNT, joints))
    found = maximise(data, motion, ROUNDS)
    shares, per_speed = by_numpy(data, motion)
    seen = np.arange(6) != 4
    np.testing.assert_allclose(found.shares[:, seen], shares[:, seen], rtol=1e-10)
    large = per_speed[:, seen] > 1e-2
    np.testing.assert_allclose(found.per_speed[:, seen][large], per_speed[:, seen][large], rtol=1e-10)
    np.testing.assert_array_equal(found.shares[:, 4], 1)
    np.testing.assert_array_equal(found.per_speed[:, 4], 0)


def test_further_steps_never_lose():
    data, motion = data_of(2), np.random.default_rng(1).uniform(0.5, 3, (COUNT, 2))
    nats = [
        log_likelihood(data, variance_of(data.stated, motion, maximise(data, motion, rounds)))
        for rounds in (1, 5, 25, 125)
    ]
    assert (np.diff(nats) > -1e-3).all()
