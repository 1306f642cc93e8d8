"""Posterior of a whole crosstalk matrix, once it is named as a cause by the few entries that explain most.

Entries look alike on a log that loads few combinations of axes, so a search for few of them may confuse them. Therefore
the posterior of all entries together is reported, each with a narrow prior. Where that is not worth its parameters, the
few entries are reported with the uncertainty of all of them together.
"""

from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.hypothesis import Hypothesis, movable, search_of
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.evaluate import whitened, with_and_without
from ftbias_jax.diagnosis.regression.fit import Fit, covariance, fit, undamped
from ftbias_jax.diagnosis.thresholds import CLOSE, ENTRY_STD, LARGEST_LEAK, LIKE_A_ROTATION, PENALTY_PER_PARAMETER
from ftbias_jax.model.effects.fitting import Entries
from ftbias_jax.model.effects.types import Effect
from ftbias_jax.setup.rotations import skew

ROTATIONS = np.kron(np.eye(2)[None], -skew(np.eye(3)))
"""(3, 6, 6) crosstalk of a small rotation of force and torque, per rad from nominal axes: R^T = 1 - [r]."""
ARMS = np.kron([[[0, 0], [1, 0]]], skew(np.eye(3)))
"""(3, 6, 6) crosstalk into the torque per m of error in the point where the force acts."""
SAME_UNIT = np.kron(np.eye(2, dtype=bool), np.ones((3, 3), bool))
"""Entries of force into force, and of torque into torque."""


class Whole(NamedTuple):
    """Fit with all E entries of a matrix that have a scale free, each with a narrow prior. F = its coordinates."""

    fit: Fit
    matrix: Hypothesis
    covariance: np.ndarray
    """(F, F)."""
    worth_its_parameters: bool
    """Whether the entries added to the few are worth their parameters."""

    def spread(self, h: Hypothesis) -> np.ndarray:
        """Covariance of the coordinates of one hypothesis."""
        return self.fit.spread(h, self.covariance)


def entries_of(problem: Problem, found: Fit) -> Hypothesis | None:
    """Hypothesis of a fit that has few entries of a matrix, if there is one."""
    return next((h for h in found.hypotheses if isinstance(problem.catalogue[h.effect].fit.search, Entries)), None)


def whole_matrix(problem: Problem, found: Fit, few: Hypothesis) -> Whole:
    """Posterior of all entries of a matrix of which a converged fit has few, together with the other parameters.

    A lever arm appears both as crosstalk of forces into torques and as the position of the tool's mass. Only the prior
    that crosstalk is small separates the two, which makes both less certain.
    """
    entries = movable(problem, problem.catalogue[few.effect])
    matrix = few._replace(free=tuple(entries), prior_std=ENTRY_STD)
    hypotheses = tuple(matrix if h is few else h for h in found.hypotheses)
    # An undamped step comes first, because products of crosstalk and a lever arm form a narrow valley for short steps.
    z = undamped(problem, hypotheses, found)
    begun = tuple(h if h.shapes else h._replace(start=tuple(z[list(h.free)])) for h in hypotheses)
    whole = fit(problem, begun, found)
    # The other hypotheses of the fit are the original objects, by which the caller identifies them.
    others = zip(found.hypotheses, begun, strict=True)
    whole = whole._replace(hypotheses=tuple(own if h is few else h for h, own in others))
    worth_its_parameters = _by_numbers(problem, whole) > _by_numbers(problem, found)
    return Whole(whole, matrix, covariance(problem, whole), worth_its_parameters)


def evidence(problem: Problem, found: Fit) -> float:
    """Log evidence of a fit in nats: its log-likelihood minus the penalties for parameters and for large crosstalk.

    Few entries of a matrix have the penalty of any other parameters. The penalty of a whole matrix is the information
    gain from prior to posterior (Laplace approximation), so that entries which the log leaves open cost nothing.
    """
    few, paid = entries_of(problem, found), _by_numbers(problem, found)
    if few is None or few.prior_std != ENTRY_STD:
        return paid
    spread = found.spread(few, covariance(problem, found))
    surer = len(few.free) * np.log(ENTRY_STD) - np.linalg.slogdet(spread)[1] / 2
    return paid + PENALTY_PER_PARAMETER * len(few.free) - float(surer)


def _by_numbers(problem: Problem, found: Fit) -> float:
    """Log evidence with the same penalty for all parameters."""
    few = entries_of(problem, found)
    entries = found.z[movable(problem, problem.catalogue[few.effect])] if few else np.zeros(0)
    unlikely = float((entries**2).sum()) / (2 * ENTRY_STD**2)
    return found.log_likelihood - PENALTY_PER_PARAMETER * found.degrees - unlikely


def doubt(problem: Problem, found: Fit, h: Hypothesis) -> str:
    """Why crosstalk may be a rotation of the sensor's axes, another lever arm, or gains: it is similar to their effect.

    A rotation or lever arm that is fitted with it is no reason for doubt.
    """
    whole = whole_matrix(problem, found, h)
    beside = [p for other in found.hypotheses for p in problem.catalogue[other.effect].parameters]
    of_entry = size_of_entries(problem.catalogue[h.effect])
    leaks = np.zeros((6, 6))
    leaks[of_entry > 0] = whole.fit.z[list(whole.matrix.free)]
    of_leaks = leaks * of_entry, of_entry, np.linalg.pinv(whole.spread(whole.matrix))
    rotation, share = nearest(ROTATIONS, *of_leaks)
    if share > LIKE_A_ROTATION and not any(p.unit == "rad" for p in beside):
        degrees = ", ".join(f"{x:.2f}" for x in np.rad2deg(rotation))
        return (
            "; or the sensor is mounted turned, or an encoder is off: the crosstalk is that of a rotation by "
            f"({degrees}) degrees"
        )
    arm, share = nearest(ARMS, *of_leaks)
    if share > LIKE_A_ROTATION and not any(p.stated == "center_of_mass" for p in beside):
        metres = ", ".join(f"{x:.2g}" for x in arm)
        return (
            f"; or the centre of mass is not where it is stated: the crosstalk is that of a lever arm of ({metres}) m"
        )
    if share_of_gains(problem, found, h) > CLOSE:
        return "; or wrong gains of channels: force and torque are correlated in this log, so gains explain it as well"
    if not whole.worth_its_parameters:  # all of them may be large: the calibration matrix of another sensor
        few = np.zeros((6, 6))
        few[of_entry > 0] = [found.z[i] if i in h.free else 0.0 for i in whole.matrix.free]
        if np.abs(few * of_entry)[SAME_UNIT].max() > LARGEST_LEAK:
            return "; or something that acts alike: no sensor leaks so much from one channel into another"
    return ""


def share_of_gains(problem: Problem, found: Fit, h: Hypothesis) -> float:
    """Share of the contribution of crosstalk to the innovations that other gains of the channels reproduce."""
    with_it, load = with_and_without(problem, found.z, h.free)
    leaked, *scaled = whitened(problem, np.concatenate([[with_it - load], load * np.eye(6)[:, None]]))
    columns = np.reshape(scaled, (6, -1)).T
    left = leaked.ravel() - columns @ np.linalg.lstsq(columns, leaked.ravel())[0]
    return 1 - float(left @ left) / max(float((leaked**2).sum()), 1e-300)


def size_of_entries(effect: Effect) -> np.ndarray:
    """(6, 6) typical departure of the entries of an effect's matrix; 0 where they are not fitted."""
    return np.broadcast_to(effect.parameter(search_of(effect, Entries).matrix).scale, (6, 6))


def nearest(made: np.ndarray, matrix: np.ndarray, size: np.ndarray, precision: np.ndarray) -> tuple[np.ndarray, float]:
    """Coefficients (3,) of ROTATIONS or ARMS that best match crosstalk (6, 6), and the share of it that they explain.

    Sizes (6, 6) are typical departures of the E entries that count, 0 for the others. The inverse covariance (E, E), in
    typical departures, is the weight, so that entries which the log does not determine do not count.
    """
    counts = size > 0
    leaks = matrix[counts] / size[counts]
    columns = np.stack([one[counts] / size[counts] for one in made], 1)
    numbers = np.linalg.lstsq(columns.T @ precision @ columns, columns.T @ precision @ leaks)[0]
    left = leaks - columns @ numbers
    return numbers, 1 - float(left @ precision @ left) / max(float(leaks @ precision @ leaks), 1e-300)
