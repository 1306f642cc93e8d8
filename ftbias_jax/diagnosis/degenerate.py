"""Logs on which a fit breaks down: an error of ours instead of one of linear algebra."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

import numpy as np

from ftbias_jax.errors import LogError

P = ParamSpec("P")
R = TypeVar("R")


def with_typed_errors(verb: Callable[P, R]) -> Callable[P, R]:
    """The same function, which raises a LogError where its equations have no solution."""

    @wraps(verb)
    def run(*arguments: P.args, **named: P.kwargs) -> R:
        try:
            return verb(*arguments, **named)
        except np.linalg.LinAlgError as error:
            message = f"the log is no basis for a diagnosis: {error}"
            remedy = "check its values with ftbias info: a stream may be constant, or far beyond its range"
            raise LogError(message, remedy=remedy) from error

    return run
