"""Loops compiled as a whole, or over pieces of a padded log, give the same results as plain ones."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.runtime import compiled_loops
from ftbias_jax.runtime.compiled_loops import PIECE, compile_whole, log_by_log_with_slopes, one_at_a_time, over_pieces

RNG = np.random.default_rng(0)
X = RNG.normal(size=(50, 3))
FACTOR = np.array([0.5, -0.9, 0.2])
ROOM = 4 * PIECE


def smoothed(factor, x):
    """Exponentially weighted sums, and their squares."""

    def body(state, x):
        state = compile_whole(lambda state, x: factor * state + x)(state, x)
        return state, (state, state**2)

    return jax.lax.scan(body, jnp.zeros(3), x)


def expected(factor, x):
    state, states = np.zeros(3), []
    for row in x:
        state = factor * state + row
        states.append(state)
    return state, (np.stack(states), np.stack(states) ** 2)


def assert_close(got, wanted):
    for one, other in zip(jax.tree.leaves(got), jax.tree.leaves(wanted), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-13, atol=1e-13)


def test_a_loop_with_a_part_that_is_worked_out_once():
    assert_close(jax.jit(compile_whole(smoothed))(FACTOR, X), expected(FACTOR, X))


def test_arguments_that_are_constants_of_the_program():
    """XLA moves constants into calls, and ends the process if the call is a marked one."""

    def of_measured(factor, x):
        return smoothed(factor, jnp.where(jnp.isfinite(x[:, 0]), x[:, 0], 0))

    wanted = expected(FACTOR, X)
    constant = jnp.asarray(X[:, None])
    assert_close(jax.jit(lambda factor: compile_whole(of_measured)(factor, constant))(FACTOR), wanted)
    assert_close(jax.jit(lambda x: compile_whole(smoothed)(jnp.asarray(FACTOR), x))(X), wanted)


def test_what_is_not_used_may_be_missing():
    last = jax.jit(lambda factor, x: compile_whole(smoothed)(factor, x)[0])
    assert_close(last(FACTOR, X), expected(FACTOR, X)[0])


def test_one_at_a_time_under_vmap():
    many = np.stack([X, 2 * X, X**2])
    got = jax.jit(jax.vmap(one_at_a_time(compile_whole(smoothed)), (None, 0)))(FACTOR, many)
    for i, x in enumerate(many):
        assert_close(jax.tree.map(lambda leaf, i=i: leaf[i], got), expected(FACTOR, x))


def test_log_by_log_under_nested_vmap_and_in_slopes():
    """Logs are processed one by one, however nested; a skipped part is not computed, unlike in a mapped ``cond``."""
    calls = []

    def work(factor, x):
        jax.debug.callback(lambda: calls.append(1))
        return {"sum": (factor * x**2).sum()}

    def one(factor, x):
        return jax.lax.cond(x.sum() > 0, work, lambda factor, x: {"sum": jnp.zeros(())}, factor, x)

    many = np.abs(X[:6]).reshape(2, 3, 3) * np.array([1, 0, 1])[None, :, None]
    mapped = jax.vmap(jax.vmap(log_by_log_with_slopes(one), (None, 0)), (None, 0))
    found = mapped(FACTOR, many)
    jax.effects_barrier()
    np.testing.assert_allclose(found["sum"], many**2 @ FACTOR)
    assert len(calls) == 4
    slopes = jax.grad(lambda factor: mapped(factor, many)["sum"].sum())(FACTOR)
    np.testing.assert_allclose(slopes, (many**2).sum((0, 1)))


def test_slopes_of_what_one_of_many_arguments_asks_for():
    """Logs are processed one after the other: no derivative is computed of a part that a log skips."""
    calls = []

    @jax.custom_vjp
    def square(x):
        return (x**2).sum()

    def back(x, bar):
        jax.debug.callback(lambda: calls.append(1))
        return (2 * x * bar,)

    square.defvjp(lambda x: (square(x), x), back)

    def one(factor, log):
        return jax.lax.cond(log["on"].any(), lambda x: factor * square(x), lambda x: jnp.zeros(()), log["x"])

    logs = {"x": np.abs(X[:4]), "on": np.array([[True], [False], [True], [False]])}
    total = lambda x: jax.vmap(log_by_log_with_slopes(one), (None, 0))(3.0, logs | {"x": x}).sum()  # noqa: E731
    slopes = jax.grad(total)(logs["x"])
    jax.effects_barrier()
    np.testing.assert_allclose(slopes, 6 * logs["x"] * logs["on"])
    assert len(calls) == 2


@jax.jit
def both_ways(x, length):
    """Sums up to each sample, and from each sample on; padding is zero, so it changes neither."""

    def forth(total, x):
        sums = total + jnp.cumsum(x)
        return sums[-1], sums

    def back(total, x):
        sums = total + jnp.cumsum(x[::-1])[::-1]
        return sums[0], sums

    return over_pieces(forth, x[0] * 0, x, length), over_pieces(back, x[0] * 0, x, length, reverse=True)


@pytest.mark.parametrize("length", [1, PIECE, PIECE + 1, ROOM])
def test_a_state_is_carried_through_the_pieces_of_the_log_and_no_others(length):
    x = np.zeros(ROOM, np.float32)
    x[:length] = np.random.default_rng(0).integers(1, 9, length)
    (end, forth), (start, back) = both_ways(x, length)
    assert end == start == x.sum()
    np.testing.assert_array_equal(forth[:length], np.cumsum(x)[:length])
    np.testing.assert_array_equal(back[:length], np.cumsum(x[::-1])[::-1][:length])
    worked_on = PIECE * -(-length // PIECE)
    np.testing.assert_array_equal(forth[worked_on:], 0)  # otherwise it would be the sum so far


def test_slopes_pass_through_the_pieces():
    def total(scale):
        def work(state, x):
            return state + (scale * x).sum(), None

        return over_pieces(work, 0.0, jnp.ones(ROOM), PIECE + 1)[0]

    assert jax.grad(total)(2.0) == 2 * PIECE


def test_a_forward_pass_is_traced_once_whatever_another_trace_would_keep():
    """This also holds where JAX has traced parts of it before."""
    traces = []

    def square(x):
        traces.append(x)
        return x * x if len(traces) % 2 else jnp.exp(2 * jnp.log(x))

    x = jnp.arange(1.0, 5.0)
    values, slopes = jax.vmap(jax.value_and_grad(log_by_log_with_slopes(square)))(x)
    np.testing.assert_allclose(values, x**2, rtol=1e-12)
    np.testing.assert_allclose(slopes, 2 * x, rtol=1e-12)


ASKED = {"a": (0,), "b": (1,), "ab": (0, 1), "c": (2,)}
"""Arguments with respect to which derivatives are asked for; each keeps other arrays for the reverse pass."""


@pytest.mark.parametrize("order", list(itertools.permutations(ASKED, 3)), ids="-".join)
def test_derivatives_do_not_depend_on_those_that_were_asked_for_before(order):
    """JAX reuses the trace of a forward pass, but the structure of its residuals is that of the latest trace."""

    def work(a, b, c):
        return jnp.sin(a * b).sum() * jnp.exp(c) + (a**2).sum()

    one = jax.jit(lambda *values: log_by_log_with_slopes(work)(*values))
    values = (jnp.asarray(X[0]), jnp.asarray(X[1]), jnp.asarray(0.3))
    for names in (*order, *order):
        for through in (lambda f: f, jax.jit):  # the second is traced anew around the same inner program
            got = jax.grad(through(lambda *values: one(*values)), ASKED[names])(*values)
            for x, y in zip(got, jax.grad(work, ASKED[names])(*values), strict=True):
                np.testing.assert_allclose(x, y, rtol=1e-6)


def test_a_reverse_pass_that_keeps_too_much_is_refused(monkeypatch):
    monkeypatch.setattr(compiled_loops, "SLOTS", 1)
    with pytest.raises(ValueError, match=r"keeps \d arrays, more than the 1 that"):
        jax.grad(log_by_log_with_slopes(lambda a, b: (jnp.sin(a) * jnp.cos(b) * b).sum()))(X[0], X[1])
