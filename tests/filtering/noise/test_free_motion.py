"""Logs with contact throughout are distinguished from those with a wrong model and those that are free for a while."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made_series import STD, gauss_markov, stamps

from ftbias_jax.filtering.noise.blocks import in_blocks, layout_of
from ftbias_jax.filtering.noise.free_motion import hidden_bias

T = stamps(30.0, 200.0)
LAYOUT = layout_of(np.diff(T))
BIAS = np.array([3.0, -5.0, 1.0, 0.1, 0.2, -0.1])
PRIOR = SimpleNamespace(prior_mean=np.zeros(12), prior_std=np.repeat([10.0, 0.5, 1.0], [3, 3, 6]))


@jax.jit
def found_in(y, tool, length, mean, std):
    blocks = in_blocks(
        LAYOUT,
        jnp.asarray(T, y.dtype),
        y,
        jnp.zeros((len(T), 2), y.dtype),
        jnp.broadcast_to(jnp.asarray(STD**2, y.dtype), y.shape),
        length=length,
        tool=tool,
    )
    stated = SimpleNamespace(prior_mean=mean, prior_std=std)
    return hidden_bias(blocks, blocks.tool, LAYOUT, stated)


def hidden(error, tool, length=6000):
    """Width of the hidden bias of a log with this error (T, 6) beside noise and bias."""
    noise = STD * np.random.default_rng(1).normal(size=error.shape)
    prior = PRIOR.prior_mean.astype(error.dtype), PRIOR.prior_std.astype(error.dtype)
    return np.asarray(found_in((BIAS + error + noise).astype(error.dtype), tool.astype(error.dtype), length, *prior))


@pytest.fixture(scope="module")
def tool():
    """(T, 6) wrench of a tool of 1 kg that turns."""
    angle = np.stack([0.9 * np.sin(0.7 * T), 0.8 * np.cos(0.4 * T)], 1)
    up = np.stack([np.sin(angle[:, 0]), np.sin(angle[:, 1]) * np.cos(angle[:, 0]), np.prod(np.cos(angle), 1)], 1)
    return np.concatenate([9.8 * up, np.cross([0.01, 0.02, 0.05], 9.8 * up)], 1)


def push(size, time=0.7, seed=0):
    """(T, 6) wrench of a hand that never lets go."""
    rng = np.random.default_rng(seed)
    force = size * (rng.normal(size=3) + 0.5 * gauss_markov(rng, T, np.ones(3), time))
    return np.concatenate([force, np.cross([0.0, 0.05, 0.1], force)], 1)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("size", [5.0, 20.0])
def test_what_a_hand_pushes_is_within_the_width(tool, size, seed):
    force = push(size, seed=seed)
    width = hidden(force, tool)
    assert (width > 0).all()
    assert (np.abs(np.median(force, 0)) < 3 * width).all()


@pytest.mark.parametrize(
    "wrong",
    [
        lambda tool: 0 * tool,
        lambda tool: 0.5 * tool,
        lambda tool: tool @ np.random.default_rng(3).normal(size=(6, 6)) * 0.2,
        lambda tool: tool - np.stack([np.interp(T - 0.3, T, column) for column in tool.T], 1),
    ],
    ids=["nothing", "mass", "crosstalk", "lag"],
)
def test_a_model_that_is_wrong_is_no_touch(tool, wrong):
    np.testing.assert_array_equal(hidden(wrong(tool), tool), 0)


def test_three_seconds_without_a_touch_are_free_motion(tool):
    force = push(10.0)
    assert hidden(force, tool).all()
    np.testing.assert_array_equal(hidden(np.where(((T > 13) & (T < 17.5))[:, None], 0, force), tool), 0)


def test_padding_and_precision_change_nothing(tool):
    force, length = push(10.0), 4000
    rows = np.arange(len(T)) < length
    whole = hidden(np.where(rows[:, None], force, np.nan), tool, length)
    assert whole.all()
    single = hidden(np.where(rows[:, None], force, 7.0).astype(np.float32), tool, length)
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, whole, rtol=1e-3)


def test_an_offset_of_kilonewtons_is_the_sensors(tool):
    force = push(10.0)
    force[:, 0] += 12800
    assert hidden(force, tool)[0] < 50


def test_a_sensor_that_subtracts_the_weight_may_be_off_by_half_a_newton(tool):
    assert hidden(push(10.0), 0 * tool).all()
    np.testing.assert_array_equal(hidden(push(0.5), 0 * tool), 0)


def test_a_few_seconds_say_nothing(tool):
    np.testing.assert_array_equal(hidden(push(10.0), tool, 500), 0)
