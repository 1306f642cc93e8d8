"""A tool that is heavier or lighter than the setup says shows in the force that follows its weight."""

from functools import partial

import jax
import numpy as np
import pytest
from made_series import STD, free_motion, made_blocks, stamps

from ftbias_jax.filtering.noise.blocks import Layout
from ftbias_jax.filtering.noise.contact import find_contacts, listed
from ftbias_jax.filtering.noise.levels import slow_std
from ftbias_jax.filtering.noise.tool_force import FEWEST, SEGMENT, error_of_tool_force, with_tool_as_seen

LAYOUT = Layout(25, 0.05)
found = jax.jit(partial(error_of_tool_force, layout=LAYOUT))


def turning(rng, t):
    """(N, 6) weight, 10 N, of a tool that turns about two axes."""
    a, b = (rng.uniform(0.5, 2) * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in rng.uniform(0.05, 0.3, 2))
    force = 10.0 * np.stack([np.sin(a), np.cos(a) * np.sin(b), np.cos(a) * np.cos(b)], 1)
    return np.concatenate([force, np.cross([0.0, 0.01, 0.05], force)], 1)


def blocks_with(rng, error, seconds=60.0, slow=0.0):
    t = stamps(seconds, 20)
    tool = turning(rng, t)
    other = slow * np.roll(tool, 1, axis=1)  # as a sensor that is turned, whose errors follow the motion as well
    y = free_motion(rng, t, STD / 5) - error * tool + other
    return made_blocks(t, y, STD**2)._replace(tool=tool)


@pytest.mark.parametrize("error", [0.3, -0.2, 0.05])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_error_is_found_and_nothing_where_there_is_none(error, dtype):
    for seed in range(20):
        blocks = blocks_with(np.random.default_rng(seed), error)
        blocks = jax.tree.map(lambda x: np.asarray(x, dtype) if x.dtype.kind == "f" else x, blocks)
        assert found(blocks, np.ones(len(blocks.t), bool)) == pytest.approx(error, abs=0.01)
        nothing = blocks_with(np.random.default_rng(seed), 0.0)
        assert found(nothing, np.ones(len(blocks.t), bool)) == 0


def test_errors_that_follow_the_motion_otherwise_are_not_the_tools():
    for seed in range(20):
        blocks = blocks_with(np.random.default_rng(seed), 0.0, slow=0.1)
        assert abs(found(blocks, np.ones(len(blocks.t), bool))) < 0.1
    wrong = blocks_with(np.random.default_rng(1), 0.3, slow=0.05)
    assert found(wrong, np.ones(len(wrong.t), bool)) == pytest.approx(0.3, abs=0.05)


@pytest.mark.parametrize("case", ["no weight in the reading", "not turned", "short", "in contact", "tool not known"])
def test_it_says_nothing_without_evidence(case):
    rng = np.random.default_rng(2)
    blocks = blocks_with(rng, 0.3, seconds=(FEWEST - 1) * SEGMENT if case == "short" else 60.0)
    free = np.ones(len(blocks.t), bool)
    if case == "no weight in the reading":
        blocks = blocks._replace(tool=0 * blocks.tool)
    elif case == "not turned":
        blocks = blocks._replace(tool=np.broadcast_to(blocks.tool[:1], blocks.tool.shape), mean=blocks.mean * 0)
    elif case == "in contact":
        free[:] = False
    elif case == "tool not known":
        blocks = blocks._replace(tool=None)
    assert found(blocks, free) == 0


def test_contact_and_missing_readings_are_left_out():
    blocks = blocks_with(np.random.default_rng(3), 0.1)
    touched, missing = (blocks.t > 20) & (blocks.t < 30), (blocks.t > 40) & (blocks.t < 45)
    mean = np.where(touched[:, None], blocks.mean + 20 * np.sin(blocks.t)[:, None], blocks.mean)
    blocks = blocks._replace(mean=np.where(missing[:, None], np.nan, mean))
    assert found(blocks, ~touched) == pytest.approx(0.1, abs=0.01)


@pytest.mark.parametrize("error", [0.2, -0.15])
@pytest.mark.parametrize(("start", "end"), [(20.0, 35.0), (30.0, 31.0)])
def test_a_push_beside_a_tool_that_is_not_as_stated_is_a_contact(error, start, end):
    right, wrong = (blocks_with(np.random.default_rng(4), of_tool) for of_tool in (0.0, error))
    strength = ((right.t > start) & (right.t < end)) * (1 + 0.1 * np.sin(2 * right.t))  # a steady one is a new bias
    push = np.outer(strength, [3.0, 2.0, -12.0, 0, 0, 0])
    every = np.ones(len(right.t), bool)

    @jax.jit
    def searched(blocks):
        as_seen = with_tool_as_seen(blocks, LAYOUT)
        return find_contacts(as_seen, LAYOUT, slow_std(as_seen, LAYOUT))

    def contacts_of(blocks):
        return listed(searched(blocks), blocks.t, LAYOUT)

    (known,), (one,) = (contacts_of(blocks._replace(mean=blocks.mean + push)) for blocks in (right, wrong))
    assert one.start == pytest.approx(start, abs=0.1)
    assert (one.start, one.end) == pytest.approx((known.start, known.end), abs=0.1)
    assert one.force[:3] == pytest.approx(known.force[:3], abs=0.5)
    pushed = wrong._replace(mean=wrong.mean + push)
    assert found(pushed, every) == pytest.approx(error, abs=0.02)
    assert contacts_of(wrong) == contacts_of(right) == ()
