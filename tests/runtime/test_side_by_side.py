"""Many logs side by side are each log, whatever is shared and however nested; empty parts are passed over."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.runtime import side_by_side
from ftbias_jax.runtime.side_by_side import (
    Parts,
    for_lanes,
    in_tiles,
    many_as_lanes,
    samples_as_lanes,
    scan_of_logs,
)

RNG = np.random.default_rng(0)


def leaky(factor, clock, x):
    """A sum (lanes,) that forgets with the log's own clock; factor (lanes,), clock (T, 1 or logs), x (T, lanes)."""

    def body(state, sample):
        dt, x = sample
        state = factor * state + for_lanes(dt, len(state)) * x
        return state, state

    return jax.lax.scan(body, jnp.zeros_like(x[0]), (clock, x))


def leaky_by_hand(factor, clock, x):
    state, states = np.zeros(x.shape[1]), []
    for dt, row in zip(clock, x, strict=True):
        state = factor * state + dt * row
        states.append(state)
    return state, np.stack(states)


def test_lanes_with_clocks_of_their_own_under_nested_vmap():
    factor, clock, x = RNG.uniform(size=3), RNG.uniform(size=(2, 5, 9, 1)), RNG.normal(size=(2, 5, 9, 3))
    once = jax.vmap(many_as_lanes(leaky), (None, 0, 0))
    last, states = jax.jit(jax.vmap(once, (None, 0, 0)))(factor, clock, x)
    for i in np.ndindex(2, 5):
        expected = leaky_by_hand(factor, clock[i], x[i])
        np.testing.assert_allclose(last[i], expected[0], rtol=1e-13)
        np.testing.assert_allclose(states[i], expected[1], rtol=1e-13)


def test_lanes_that_share_a_clock():
    factor, clock, x = RNG.uniform(size=(4, 3)), RNG.uniform(size=(9, 1)), RNG.normal(size=(9, 3))
    last, _ = jax.vmap(many_as_lanes(leaky), (0, None, None))(factor, clock, x)
    np.testing.assert_allclose(last, [leaky_by_hand(f, clock, x)[0] for f in factor], rtol=1e-13)


def pairs(shared, series):
    """(pieces, 2, lanes) -> (pieces, 1, lanes)."""
    x, y = series
    return {"sum": shared * (x[:, :1] * y[:, 1:] + x[:, 1:])}


@pytest.mark.parametrize("mapped", [False, True])
@pytest.mark.parametrize("length", [1, 7, 20])
def test_samples_as_lanes_of_any_log(length, mapped):
    """Lengths that do not fill a piece; what is shared by the samples of a log, or by all logs."""
    x, y = RNG.normal(size=(2, 3, length, 2))
    shared = RNG.normal(size=3) if mapped else RNG.normal()
    of_logs = jax.vmap(samples_as_lanes(pairs, 8), (0 if mapped else None, 0))
    found = of_logs(jnp.asarray(shared), (jnp.asarray(x), jnp.asarray(y)))["sum"]
    factor = np.broadcast_to(shared, 3)[:, None, None]
    np.testing.assert_allclose(found, factor * (x[:, :, :1] * y[:, :, 1:] + x[:, :, 1:]), rtol=1e-13)


def sums(calls, reverse, factor, start, x):
    """Running sums over the parts of a log, of which those that are zero are passed over."""

    def work(factor, state, part):
        jax.debug.callback(lambda: calls.append(1))
        return state + factor * part.sum(), state * part

    def pass_over(factor, state, part):
        return state, jnp.zeros_like(part)

    tests = (lambda part: part[0] > 0, lambda part: (part > 0).any())
    return scan_of_logs(Parts(work, pass_over, tests, reverse), factor, start, x)


def sums_by_hand(reverse, factor, start, x):
    state, results = start, np.zeros_like(x)
    for i in reversed(range(len(x))) if reverse else range(len(x)):
        results[i] = state * x[i]
        state = state + factor * x[i].sum()
    return state, results


@pytest.mark.parametrize("reverse", [False, True])
def test_parts_of_logs_side_by_side(reverse):
    """The third part is empty in all logs, the fourth in some."""
    x = RNG.uniform(size=(3, 5, 2))
    x[:, 2], x[:2, 3], x[1, 4, 0] = 0, 0, 0
    start, calls = RNG.uniform(size=3), []
    found = jax.vmap(partial(sums, calls, reverse), (None, 0, 0))(2.0, start, x)
    jax.effects_barrier()
    for i in range(3):
        expected = sums_by_hand(reverse, 2.0, start[i], x[i])
        np.testing.assert_allclose(found[0][i], expected[0], rtol=1e-13)
        np.testing.assert_allclose(found[1][i], expected[1], rtol=1e-13)
    assert len(calls) == 4  # one for all logs


@pytest.mark.parametrize(
    ("count", "shared", "logs"),
    [(9, None, 5), (8, None, 4), (4, None, 4), (3, None, 1), (9, 0, 1)],
    ids=["last tile filled up", "two tiles", "one tile", "too few", "nothing shared"],
)
def test_tiles(monkeypatch, count, shared, logs):
    """How many logs a tile has, and that each log is itself."""
    monkeypatch.setattr(side_by_side, "FEW", 4)
    seen = []

    @jax.custom_batching.custom_vmap
    def size_of(x):
        return jnp.zeros(())

    @size_of.def_vmap
    def rule(size, is_mapped, x):
        seen.append(size)
        return jnp.zeros(size), True

    def work(factor, x):
        return {"sum": factor * x.sum() + size_of(x)}

    factor, x = RNG.normal(size=count), RNG.normal(size=(count, 6))
    many = jax.vmap(in_tiles(work, 5), (shared, 0))
    found = many(factor if shared == 0 else factor[0], x)["sum"]
    np.testing.assert_allclose(found, (factor if shared == 0 else factor[0]) * x.sum(1), rtol=1e-12)
    assert set(seen) == ({logs} if logs > 1 else set())
    nested = jax.vmap(many, (None if shared is None else 0, 0))
    twice = nested(np.stack([factor, factor]) if shared == 0 else factor[0], np.stack([x, 2 * x]))["sum"]
    np.testing.assert_allclose(twice, np.stack([found, 2 * found]), rtol=1e-12)
