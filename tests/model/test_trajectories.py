import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.errors import LogError
from ftbias_jax.io.log import Log
from ftbias_jax.model.trajectories import excitation_sines, minimum_jerk_moves, replay

T = jnp.arange(4000) / 500
CENTER, AMPLITUDE = jnp.array([0.0, -0.5, 1.0]), jnp.array([0.8, 0.3, 1.5])


def log_of(t, q):
    nothing = np.full((len(t), 6), np.nan)
    return Log(np.asarray(t), np.asarray(q), np.full(q.shape, np.nan), nothing, np.full(len(t), np.nan), 0.0)


@pytest.mark.parametrize("generate", [excitation_sines, minimum_jerk_moves])
def test_velocity_and_acceleration_are_the_derivatives(generate):
    t, q, dq, ddq = generate(jax.random.key(1), T, CENTER, AMPLITUDE)
    inner = slice(2, -2)
    np.testing.assert_allclose(np.gradient(q, t, axis=0)[inner], dq[inner], atol=1e-4)
    np.testing.assert_allclose(np.gradient(dq, t, axis=0)[inner], ddq[inner], atol=2e-2)  # jerk jumps at a move's ends
    assert (jnp.abs(q - CENTER[None]) <= AMPLITUDE[None] + 1e-12).all()


def test_moves_rest_between_poses():
    motion = minimum_jerk_moves(jax.random.key(1), T, CENTER, AMPLITUDE, move=1.5, dwell=0.5)
    resting = np.asarray(T) % 2 >= 1.5
    np.testing.assert_array_equal(motion.dq[resting], 0)
    np.testing.assert_array_equal(motion.ddq[resting], 0)
    assert np.abs(motion.dq[~resting]).max() > 0.1


def test_replay_follows_a_recorded_log_and_its_derivatives_are_exact():
    truth = excitation_sines(jax.random.key(2), T, CENTER, AMPLITUDE)
    q = np.asarray(truth.q) + 2e-5 * np.random.default_rng(1).normal(size=truth.q.shape)
    q[::2] = np.nan  # joints at a lower rate than the timeline
    q[1000:1500, 1] = np.nan  # and a gap of a second
    motion = replay(log_of(T, q))
    inside = np.r_[50:950, 1550:3950]
    np.testing.assert_allclose(motion.q[inside], truth.q[inside], atol=3e-5)
    np.testing.assert_allclose(motion.dq[inside], truth.dq[inside], atol=3e-3)
    np.testing.assert_allclose(motion.ddq[inside], truth.ddq[inside], atol=0.3)
    fine = replay(log_of(T, q), np.linspace(1, 1.5, 5001))
    np.testing.assert_allclose(np.gradient(fine.q, fine.t, axis=0)[1:-1], fine.dq[1:-1], atol=1e-6)
    np.testing.assert_allclose(np.gradient(fine.dq, fine.t, axis=0)[1:-1], fine.ddq[1:-1], atol=1e-4)


def test_replay_needs_positions():
    q = np.full((100, 2), 0.5)
    q[5:, 1] = np.nan
    with pytest.raises(LogError, match="joint 2 has 5 positions"):
        replay(log_of(np.arange(100) / 100, q))
