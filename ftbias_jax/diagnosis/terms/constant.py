"""The constant part of a term over its logs, which is indistinguishable from the bias, and the error of the reading."""

from dataclasses import replace

import numpy as np

from ftbias_jax.diagnosis.evidence.estimates import FORM_ERROR
from ftbias_jax.diagnosis.thresholds import FAR_FROM_ZERO
from ftbias_jax.filtering.innovation_regression import stderr_of_reading
from ftbias_jax.model.effects.terms.columns import added, columns
from ftbias_jax.model.effects.terms.parse import goes_by_clock, section_of
from ftbias_jax.model.effects.terms.types import State, Term

FROM_AN_ORIGIN = ("joint_angle", "position")
"""Drives whose zero is that of a coordinate, where a cable or a spring need not be at rest."""


def without_constant(
    term: Term, state: State, spread: np.ndarray, scales: np.ndarray, noise_std: np.ndarray
) -> tuple[Term, np.ndarray]:
    """Term whose constant part is left to the bias where the logs do not determine it, and its error of the reading.

    A form that is fitted over a small range of its drive, such as a parabola in the direction of gravity, has a mean
    far beyond what it changes within the range. The mean is subtracted if its standard error exceeds that change, or if
    it is ``FAR_FROM_ZERO`` times the change and the zero of the drive means nothing.

    Args:
        term: as fitted.
        state: of the logs, U bins.
        spread: scaled covariance of the term's numbers, coefficients first.
        scales: of these numbers.
        noise_std: (6,) N, Nm, by which channels are compared.

    Returns:
        the term, and (6,) N, Nm, rms over the logs of the error due to the coefficients and to the form.
    """
    made, change = np.asarray(columns(np, term, state)), np.asarray(added(np, term, state))
    count = made.shape[1]
    spread = spread[:count, :count] * scales[:count, None] * scales[:count]
    mean, varies = change.mean(0), np.linalg.norm(change.std(0) / noise_std)
    stderr = stderr_of_reading(made.mean(0)[:, None], spread)
    uncertain = np.linalg.norm(stderr / noise_std) > varies
    arbitrary = term.drive in FROM_AN_ORIGIN and np.linalg.norm(mean / noise_std) > FAR_FROM_ZERO * varies
    if (uncertain or arbitrary) and not goes_by_clock(section_of(term)):
        term, change, made = replace(term, offset=mean), change - mean, made - made.mean(0)
    by_numbers = stderr_of_reading(made.transpose(1, 0, 2), spread)
    form = FORM_ERROR * np.sqrt((change**2).mean(0))
    return term, np.hypot(by_numbers, form)
