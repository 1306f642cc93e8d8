"""Loops over many short arrays, compiled as one function.

XLA starts a kernel for every few operations, and for arrays of a few numbers starting costs fifty times the arithmetic.
A call that carries XLA's mark of small calls is compiled as a whole instead, its loops included. A version of XLA that
does not know the mark ignores it: results are the same and take longer. Matrix products have no place in such a call.

Logs are padded to powers of two, so that logs of many lengths share a few programs. On a processor their work is done
in pieces, and a piece without a sample of the log is passed over: of a program for 8,192 samples a log of 5,000 takes
the time of 5,120.
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

PIECE = 256
"""Samples: of a log as many as half of that are padding, on average."""


def compile_whole(function: Callable[P, R]) -> Callable[P, R]:
    """The same function of arrays, compiled as a whole on a processor; on an accelerator as ever.

    Inside such a function it also marks a part whose results are to be worked out once: XLA would work cheap terms out
    again for every result that needs them, ten times over in a step of a filter.
    """

    @jax.jit
    def whole(*arguments: P.args, **named: P.kwargs) -> R:
        # The mark is for this call and not for those inside it, to which JAX would pass it on.
        with set_xla_metadata(xla_cpu_small_call="false", inlineable="true"):
            return function(*arguments, **named)

    def call(*arguments: P.args, **named: P.kwargs) -> R:
        if not on_cpu():
            return function(*arguments, **named)
        # XLA crashes on a marked call into which it has moved a constant argument; none passes a barrier.
        arguments, named = jax.lax.optimization_barrier((arguments, named))
        with set_xla_metadata(xla_cpu_small_call="true", inlineable="false"):
            return whole(*arguments, **named)

    return call


def compile_forward(function: Callable[..., R]) -> Callable[..., R]:
    """``compile_whole`` of a function whose reverse pass stays as XLA compiles it by itself, which takes longer.

    XLA aborts on a marked call that does not read all it is given, which reverse passes that JAX derives may not.
    """
    whole: Any = jax.custom_vjp(compile_whole(function))
    whole.defvjp(lambda *arguments: jax.vjp(function, *arguments), lambda pull, bar: pull(bar))
    return whole


def running_sum(x: Array) -> Array:
    """Sums over the first axis; ``jnp.cumsum`` takes several times as long to compile and to run on a processor."""
    return compile_whole(_running_sum)(x)


def _running_sum(x: Array) -> Array:
    def add(total: Array, value: Array) -> tuple[Array, Array]:
        total = total + value
        return total, total

    return jax.lax.scan(add, jnp.zeros_like(x[0]), x)[1]


def one_at_a_time(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same function, which ``vmap`` on a processor turns into a loop: the arrays of one call stay in the cache."""
    return _looped(function, nested=False)


def log_by_log(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same function of a whole log, of which ``vmap`` on a processor takes one log after the other, however nested.

    Many logs take no longer than each by itself, and what the function leaves out of one log is left out.
    """
    return _looped(function, nested=True)


def _looped(function: Callable[..., Any], *, nested: bool) -> Callable[..., Any]:
    """A function that ``vmap`` on a processor turns into a loop; a further one as well, if it is ``nested``."""
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
    """``log_by_log`` for a function that is differentiated too, one log after the other as well.

    Derivatives are worked out with respect to the arguments for which they are asked, and no others.
    """
    if not on_cpu():
        return function
    whole: Any = jax.custom_vjp(log_by_log(function))
    structure: Any = None  # of what the reverse pass keeps, found while the forward pass is traced

    def forward(*primals: Any) -> tuple[Any, Any]:
        leaves, tree = jax.tree.flatten(primals)
        asked = [x.perturbed for x in leaves]

        def one_log(*values: Array) -> tuple[Any, list[Array]]:
            nonlocal structure
            found, pull = jax.vjp(*of_some(function, asked, jax.tree.unflatten(tree, values)))
            kept, structure = jax.tree.flatten(pull)
            return found, kept

        values = [x.value for x in leaves]
        # Traced here alone: another trace may keep other values, and the loop and the reverse pass count on these.
        traced, shapes = jax.make_jaxpr(one_log, return_shape=True)(*values)

        def as_traced(*values: Array) -> tuple[Any, list[Array]]:
            return jax.tree.unflatten(jax.tree.structure(shapes), jaxpr_as_fun(traced)(*values))

        found, kept = _differentiated_once(log_by_log(as_traced))(*values)
        return found, (kept, jax.tree.unflatten(tree, [() if a else None for a in asked]))

    def backward(residual: Any, bar: Any) -> Any:
        kept, asked = residual
        bar = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype) if isinstance(x, SymbolicZero) else x, bar)
        (slopes,) = log_by_log(lambda kept, bar: jax.tree.unflatten(structure, kept)(bar))(kept, bar)
        rest = iter(slopes)
        return jax.tree.map(lambda a: None if a is None else next(rest), asked, is_leaf=lambda a: a in (None, ()))

    whole.defvjp(forward, backward, symbolic_zeros=True)
    return whole


def _differentiated_once(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same function of a forward pass, which has no derivatives of its own: its reverse pass is written by hand."""
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
        work: state, and a piece of the log -> the state after it, and results with a leading time axis; padding must
            not change the state.
        state: before the first piece, or after the last one.
        log: a tree of arrays (T, ...).
        length: samples at the start that are of the log; what is worked out for the others means nothing.
        reverse: from the last piece to the first.

    Returns:
        the last state and the results (T, ...).
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
    """The function of the chosen leaves of its arguments alone, and these."""
    leaves, structure = jax.tree.flatten(arguments)
    is_chosen = jax.tree.leaves(tuple(chosen))

    def one(parts: list[Array]) -> Any:
        rest = iter(parts)
        whole = [next(rest) if c else x for x, c in zip(leaves, is_chosen, strict=True)]
        return function(*jax.tree.unflatten(structure, whole))

    return one, [x for x, c in zip(leaves, is_chosen, strict=True) if c]


def on_cpu() -> bool:
    """Whether programs run on the processor, where loops of short steps are quick."""
    config: Any = jax.config  # JAX's types do not know its settings
    chosen = config.jax_default_device
    return (getattr(chosen, "platform", chosen) or jax.default_backend()) == "cpu"
