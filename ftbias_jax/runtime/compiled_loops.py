"""Loops over many short arrays, compiled as one function.

XLA launches a kernel for every few operations, and for arrays of a few numbers the launch costs fifty times the
arithmetic. A call with XLA's attribute ``xla_cpu_small_call`` is compiled as a single function instead, loops included.
XLA versions that do not know it give the same results and take longer. Such a call must not contain matrix products.

Logs are padded to powers of two, so that logs of many lengths share a few programs. On a CPU they are processed in
pieces, and a piece that holds only padding is skipped: in a program for 8,192 samples, a log of 5,000 samples takes the
time of 5,120.
"""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import jax
import jax.custom_batching
import jax.numpy as jnp
from jax import Array
from jax.custom_derivatives import SymbolicZero
from jax.experimental.xla_metadata import set_xla_metadata
from jax.extend.core import jaxpr_as_fun

P = ParamSpec("P")
R = TypeVar("R")

SLOTS = 1024
"""Maximum number of arrays that the reverse pass of a log keeps; most keep 20 to 200."""
PIECE = 256
"""Samples per piece; on average, half a piece per log is padding."""


def compile_whole(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function of arrays as a whole on a CPU; on an accelerator the call is unchanged.

    Used inside such a function, it also marks a part whose results are to be computed once: XLA recomputes cheap shared
    subexpressions for every result that needs them, ten times over in a filter step.
    """

    @jax.jit
    def whole(*arguments: P.args, **named: P.kwargs) -> R:
        # The attributes are meant for this call only; JAX would pass them on to the calls inside it.
        with set_xla_metadata(xla_cpu_small_call="false", inlineable="true"):
            return function(*arguments, **named)

    def call(*arguments: P.args, **named: P.kwargs) -> R:
        if not on_cpu():
            return function(*arguments, **named)
        # XLA crashes on a marked call into which it has moved a constant argument; the barrier prevents that.
        arguments, named = jax.lax.optimization_barrier((arguments, named))
        with set_xla_metadata(xla_cpu_small_call="true", inlineable="false"):
            return whole(*arguments, **named)

    return call


def compile_forward(function: Callable[..., R]) -> Callable[..., R]:
    """Apply ``compile_whole`` to the forward pass only; XLA compiles the reverse pass as usual, which takes longer.

    XLA aborts on a marked call that leaves an argument unread, which reverse passes that JAX derives may do.
    """
    whole: Any = jax.custom_vjp(compile_whole(function))
    whole.defvjp(lambda *arguments: jax.vjp(function, *arguments), lambda pull, bar: pull(bar))
    return whole


def running_sum(x: Array) -> Array:
    """Cumulative sums over the first axis; ``jnp.cumsum`` takes several times as long to compile and run on a CPU."""
    return compile_whole(_running_sum)(x)


def _running_sum(x: Array) -> Array:
    def add(total: Array, value: Array) -> tuple[Array, Array]:
        total = total + value
        return total, total

    return jax.lax.scan(add, jnp.zeros_like(x[0]), x)[1]


def one_at_a_time(function: Callable[..., Any]) -> Callable[..., Any]:
    """Make ``vmap`` of a function a loop on a CPU, so that the arrays of one call stay in the cache."""
    return _looped(function, nested=False)


def log_by_log(function: Callable[..., Any]) -> Callable[..., Any]:
    """Make ``vmap`` of a function of a whole log process one log after the other on a CPU, however deeply nested.

    Many logs take no longer than each separately, and work that the function skips for a log is really skipped.
    """
    return _looped(function, nested=True)


def _looped(function: Callable[..., Any], *, nested: bool) -> Callable[..., Any]:
    """A function that ``vmap`` turns into a loop on a CPU; if ``nested``, every further ``vmap`` does so as well."""
    if not on_cpu():
        return function
    looped: Any = jax.custom_batching.custom_vmap(function)
    inside = looped if nested else function

    def rule(count: int, is_mapped: Any, *arguments: Any) -> tuple[Any, Any]:
        one, mapped = of_some(inside, is_mapped, arguments)
        found = jax.lax.map(one, mapped) if mapped else one(mapped)
        return found, jax.tree.map(lambda _: bool(mapped), found)

    looped.def_vmap(rule)
    return looped


def log_by_log_with_slopes(function: Callable[..., Any]) -> Callable[..., Any]:
    """``log_by_log`` for a function that is differentiated: the reverse pass also processes one log after the other.

    Derivatives are computed only with respect to the arguments for which they are requested.
    """
    if not on_cpu():
        return function
    whole: Any = jax.custom_vjp(log_by_log(function))
    # For each trace of the forward pass: the structure of what it keeps, and the derivatives that are asked for.
    traces = list[tuple[Any, Any]]()

    def forward(*primals: Any) -> tuple[Any, Any]:
        leaves, tree = jax.tree.flatten(primals)
        asked = [x.perturbed for x in leaves]

        def one_log(*values: Array) -> tuple[Any, Any]:
            return jax.vjp(*of_some(function, asked, jax.tree.unflatten(tree, values)))

        values = [x.value for x in leaves]
        # Traced only here: another trace may keep other residuals, and the loop and the reverse pass rely on these.
        traced, shapes = jax.make_jaxpr(one_log, return_shape=True)(*values)

        def as_traced(*values: Array) -> tuple[Any, Any]:
            return jax.tree.unflatten(jax.tree.structure(shapes), jaxpr_as_fun(traced)(*values))

        found, pull = _differentiated_once(log_by_log(as_traced))(*values)
        kept, structure = jax.tree.flatten(pull)
        if len(kept) > SLOTS:
            raise ValueError(f"the reverse pass keeps {len(kept)} arrays, more than the {SLOTS} that there is room for")
        traces.append((structure, jax.tree.unflatten(tree, [() if a else None for a in asked])))
        # JAX may reuse this trace with the residuals' structure of a later one, in which other derivatives were asked
        # for: all traces return equally many arrays, and the shape of the last one says which trace it was.
        nothing = jnp.zeros(0)
        return found, [*kept, *[nothing] * (SLOTS - len(kept)), jnp.zeros((0, len(traces) - 1))]

    def backward(residual: Any, bar: Any) -> Any:
        structure, asked = traces[residual[-1].shape[1]]
        kept = residual[: structure.num_leaves]
        bar = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype) if isinstance(x, SymbolicZero) else x, bar)
        (slopes,) = log_by_log(lambda kept, bar: jax.tree.unflatten(structure, kept)(bar))(kept, bar)
        rest = iter(slopes)
        return jax.tree.map(lambda a: None if a is None else next(rest), asked, is_leaf=lambda a: a in (None, ()))

    whole.defvjp(forward, backward, symbolic_zeros=True)
    return whole


def _differentiated_once(function: Callable[..., Any]) -> Callable[..., Any]:
    """The forward pass without derivatives of its own, because its reverse pass is written by hand."""
    once: Any = jax.custom_jvp(function)

    def refuse(primals: Any, tangents: Any) -> Any:
        raise TypeError("can't apply forward-mode differentiation (jvp) to a function that has a reverse pass alone")

    once.defjvp(refuse)
    return once


def over_pieces(
    work: Callable[[Any, Any], tuple[Any, Any]], state: Any, log: Any, length: int | Array, *, reverse: bool = False
) -> tuple[Any, Any]:
    """Carry a state through the pieces of a padded log.

    Args:
        work: maps the state and a piece of the log to the next state and results with a leading time axis; padding must
            not change the state.
        state: initial state, before the first piece or, if ``reverse``, after the last one.
        log: a pytree of arrays (T, ...).
        length: number of samples at the start that belong to the log; results of the padding after them are undefined.
        reverse: process the pieces from the last to the first.

    Returns:
        the final state and the results (T, ...).
    """
    room = len(jax.tree.leaves(log)[0])
    if room <= PIECE or room % PIECE or not on_cpu():
        return work(state, log)
    pieces = jax.tree.map(lambda x: x.reshape(-1, PIECE, *x.shape[1:]), log)
    shapes = jax.eval_shape(work, state, jax.tree.map(lambda x: x[0], pieces))[1]

    def pass_over(state: Any, piece: Any) -> tuple[Any, Any]:
        return state, jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)

    def body(state: Any, numbered: Any) -> tuple[Any, Any]:
        first, piece = numbered
        return jax.lax.cond(first < length, work, pass_over, state, piece)

    numbered = (jnp.arange(0, room, PIECE), pieces)
    last, found = jax.lax.scan(body, state, numbered, reverse=reverse)
    return last, jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), found)


def of_some(function: Any, chosen: Any, arguments: Any) -> tuple[Callable[[list[Array]], Any], list[Array]]:
    """Restrict a function to the chosen leaves of its arguments; returns the restricted function and these leaves."""
    leaves, structure = jax.tree.flatten(arguments)
    is_chosen = jax.tree.leaves(tuple(chosen))

    def one(parts: list[Array]) -> Any:
        rest = iter(parts)
        whole = [next(rest) if c else x for x, c in zip(leaves, is_chosen, strict=True)]
        return function(*jax.tree.unflatten(structure, whole))

    return one, [x for x, c in zip(leaves, is_chosen, strict=True) if c]


def on_cpu() -> bool:
    """Whether programs run on a CPU, where loops of short steps are fast."""
    config: Any = jax.config  # JAX's type hints lack its settings
    chosen = config.jax_default_device
    return (getattr(chosen, "platform", chosen) or jax.default_backend()) == "cpu"
