"""Loops over many short arrays as one compiled function.

XLA starts a kernel for every few operations, and for arrays of a few numbers starting costs fifty times the arithmetic.
A call that carries XLA's own mark of small calls is compiled as a whole instead. A version of XLA that does not know
the mark ignores it: the results are the same, and take longer.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar, cast

import jax
from jax.experimental.xla_metadata import set_xla_metadata

P = ParamSpec("P")
R = TypeVar("R")


def small(function: Callable[P, R]) -> Callable[P, R]:
    """The same function of arrays, compiled as a whole on a processor; on an accelerator as ever."""

    @jax.jit
    @wraps(function)
    def whole(*arguments: P.args, **named: P.kwargs) -> R:
        # The mark is for this call and not for those inside it.
        with set_xla_metadata(xla_cpu_small_call=None, inlineable=None):
            return function(*arguments, **named)

    @wraps(function)
    def call(*arguments: P.args, **named: P.kwargs) -> R:
        if jax.default_backend() != "cpu":
            return function(*arguments, **named)
        with set_xla_metadata(xla_cpu_small_call="true", inlineable="false"):
            return cast(R, whole(*arguments, **named))

    return call
