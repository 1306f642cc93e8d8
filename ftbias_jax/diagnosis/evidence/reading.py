"""How far the reading of a model may be off by the numbers that were fitted: no noise, so the bias takes it up."""

from collections.abc import Collection

import numpy as np

from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.evaluate import slopes
from ftbias_jax.diagnosis.regression.fit import Fit, covariance


def stderr_of_reading(problem: Problem, found: Fit, given: Collection[str] = ()) -> np.ndarray | None:
    """(6,) N, Nm: standard error of the mean reading by the coordinates of a fit, root mean square over the logs.

    To first order, J S J^T. Numbers of one effect may be uncertain together, as a cable's stiffness and length are, and
    their pull is known well.

    Args:
        problem: the logs.
        found: a fit of them.
        given: effects whose errors stand elsewhere: S is the covariance of the others if these were known.

    Returns:
        None without coordinates, or where the log does not determine them.
    """
    effect_of = {i: h.effect for h in found.hypotheses for i in h.free}
    own = [k for k, i in enumerate(found.free) if effect_of[i] not in given]
    known = [k for k, i in enumerate(found.free) if effect_of[i] in given]
    if not own:
        return None
    try:
        spread = covariance(problem, found)
        beside = spread[np.ix_(own, known)]
        spread = spread[np.ix_(own, own)] - beside @ np.linalg.solve(spread[np.ix_(known, known)], beside.T)
    except np.linalg.LinAlgError:  # of columns that are no numbers, or all the same
        return None
    columns = slopes(problem, found.z, [found.free[k] for k in own])
    variance = np.einsum("iuc,ij,juc->uc", columns, spread, columns, optimize=True)
    stderr: np.ndarray = np.sqrt(np.maximum(variance, 0.0).mean(0))
    return stderr if np.isfinite(stderr).all() else None
