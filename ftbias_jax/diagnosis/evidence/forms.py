"""Uncertainty of an effect's parameters due to the model form of the others, which is never quite the real one.

Another form acts earlier or later or, in a joint, varies with its angle. The resulting changes of the readings are
fitted together with all else, with a prior as large as the effect itself; parameters they move are no better known.
"""

import numpy as np

from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.design_matrix import information, products
from ftbias_jax.diagnosis.regression.evaluate import over_bins, whitened, with_and_without
from ftbias_jax.diagnosis.regression.fit import Fit


def spread_by_other_forms(problem: Problem, fit: Fit, h: Hypothesis) -> np.ndarray:
    """(F, F) covariance that other forms of the other effects add to the coordinates of a hypothesis, to first order.

    It contains the posterior covariance of these forms and the shift of the coordinates by their estimates.
    """
    # A tool is a rigid body whatever its parameters are, so it has no other form.
    others = [x for x in fit.hypotheses if x is not h and x.free and problem.catalogue[x.effect].stage != "tool"]
    if not others:
        return np.zeros((len(h.free), len(h.free)))
    forms = np.concatenate([_other_forms(problem, fit, other) for other in others])
    flat, shared = forms.reshape(len(forms), -1), products(fit.columns, np.concatenate([forms, fit.error[None]]))
    by_form = information(fit.columns).solve(shared[:-1].T)
    spread = np.linalg.inv(flat @ flat.T - shared[:-1] @ by_form + np.eye(len(forms)))
    shown = spread @ (flat @ fit.error.ravel() - by_form.T @ shared[-1])
    moved = by_form[fit.places(h)]
    return np.asarray(moved @ (spread + np.outer(shown, shown)) @ moved.T)


def _other_forms(problem: Problem, fit: Fit, h: Hypothesis) -> np.ndarray:
    """(M, U, 6) whitened changes of the readings by other forms, each as large as the hypothesis's own effect."""
    with_it, without = with_and_without(problem, fit.z, h.free)
    acts = with_it - without
    rate = np.zeros_like(acts)
    for log in range(len(problem.parts)):
        rows = problem.log == log
        rate[rows] = np.gradient(acts[rows], problem.t[rows], axis=0)
    forms = [rate]
    if isinstance(h.detail, int):
        angle = over_bins(problem, lambda part: part.signals.q)[:, h.detail - 1, None]
        forms += [acts * np.sin(angle), acts * np.cos(angle)]
    size, *sizes = np.linalg.norm(white := whitened(problem, np.stack([acts, *forms])), axis=(1, 2))
    return white[1:] * (size / np.maximum(sizes, np.finfo(float).tiny))[:, None, None]
