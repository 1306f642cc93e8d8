"""Contact as a filter finds it, for the diagnosis."""

import numpy as np
import pytest

from ftbias_jax.filtering.method.look import contacts_in, scatter_at_rest
from ftbias_jax.io.log import Log

NOISE = np.repeat([0.1, 0.004], 3)
T = np.arange(4000) / 200
SPEED = np.zeros((4000, 6))


def found(push, rezeroed_at=(), rows=slice(None)):
    """Contacts in noise, an error of the model that moves slowly, and a push on fx."""
    error = NOISE * np.random.default_rng(0).normal(size=(4000, 6))
    error[:, 2] += 0.3 * np.sin(0.5 * T)
    error[:, 0] += push
    t, error = T[rows], error[rows]
    nothing = np.full((len(t), 6), np.nan)
    log = Log(t, nothing, nothing, -error, nothing[:, 0], rezeroed_at=rezeroed_at)
    return contacts_in(log, 0 * error, SPEED[rows], np.tile(NOISE**2, (len(t), 1))).contacts


def test_a_long_push_is_one_contact():
    (contact,) = found(8.0 * ((T > 5) & (T < 13)) * (1 + 0.5 * np.sin(3 * T)))
    assert (contact.start, contact.end) == pytest.approx((5, 13), abs=0.1)


def test_what_is_slow_is_none():
    assert found(3.0 * np.sin(0.4 * T)) == ()


def test_a_sensor_that_is_zeroed_is_not_touched():
    twice = 6.0 * ((T >= 11.0) & (T < 13.0))
    assert len(found(twice)) == 1
    assert found(twice, rezeroed_at=(10.9975, 12.9975)) == ()


def test_a_short_log_says_nothing():
    assert found(8.0 * (T > 0.5), rows=slice(0, 200)) == ()


@pytest.mark.parametrize("stated", [0.5, 3.0])
def test_the_scatter_at_rest_is_that_within_blocks(stated):
    error = NOISE * np.random.default_rng(0).normal(size=(4000, 6)) + 0.3 * np.sin(0.5 * T)[:, None]
    nothing = np.full((4000, 6), np.nan)
    log = Log(T, nothing, nothing, -error, nothing[:, 0])
    blocks = error.reshape(400, 10, 6)
    line = np.stack([np.ones(10), np.arange(10) - 4.5], 1)
    left = blocks - line @ (np.linalg.pinv(line) @ blocks)
    within = np.sqrt((left**2).sum((0, 1)) / (8 * 400))
    found = scatter_at_rest(log, error, SPEED, np.tile((stated * NOISE) ** 2, (4000, 1)), stated * NOISE)
    np.testing.assert_allclose(found, within / (stated * NOISE), rtol=0.01)


def test_a_short_log_says_nothing_of_its_scatter():
    few = slice(0, 200)
    nothing = np.full((200, 6), np.nan)
    log = Log(T[few], nothing, nothing, nothing, nothing[:, 0])
    np.testing.assert_array_equal(scatter_at_rest(log, nothing, SPEED[few], nothing, NOISE), np.ones(6))
