"""Standard error of a model's mean reading due to its fitted parameters: it is not noise, so the bias absorbs it."""

from collections.abc import Collection

import numpy as np

from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.evaluate import slopes
from ftbias_jax.diagnosis.regression.fit import Fit, covariance
from ftbias_jax.filtering import innovation_regression


def stderr_of_reading(problem: Problem, found: Fit, given: Collection[str] = ()) -> np.ndarray | None:
    """(6,) N, Nm: standard error of the mean reading due to a fit's coordinates, root mean square over the logs.

    To first order, J S J^T. Parameters of one effect may each be uncertain while the reading they predict is well
    known, as with the stiffness and the length of a cable and its pull.

    Args:
        problem: the logs.
        found: a fit of them.
        given: effects whose errors are reported elsewhere: S is the covariance of the other coordinates given these.

    Returns:
        None without coordinates, or where the log does not determine them.
    """
    effect_of = {i: h.effect for h in found.hypotheses for i in h.free}
    own = [k for k, i in enumerate(found.free) if effect_of[i] not in given]
    known = [k for k, i in enumerate(found.free) if effect_of[i] in given]
    if not own:
        return None
    try:
        spread = innovation_regression.conditional(covariance(problem, found), own, known)
    except np.linalg.LinAlgError:  # columns are NaN or identical
        return None
    columns = slopes(problem, found.z, [found.free[k] for k in own])
    stderr = innovation_regression.stderr_of_reading(columns, spread)
    return stderr if np.isfinite(stderr).all() else None
