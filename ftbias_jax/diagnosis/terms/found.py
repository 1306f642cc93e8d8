"""Terms of a description as the result tells them: numbers with standard errors, words, and what the plot shows."""

from __future__ import annotations

import numpy as np

from ftbias_jax.diagnosis.evidence.estimates import FORM_ERROR
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.fit import covariance
from ftbias_jax.diagnosis.result import FoundTerm, Gap
from ftbias_jax.diagnosis.terms.curves import curve_of
from ftbias_jax.diagnosis.terms.describe import Description
from ftbias_jax.diagnosis.terms.phrases import DRIVE_WORDS, resembles
from ftbias_jax.diagnosis.terms.words import grouped, sentence, statement
from ftbias_jax.model.effects.terms.columns import has_point
from ftbias_jax.model.effects.terms.forms import FORMS
from ftbias_jax.model.effects.terms.parse import section_of
from ftbias_jax.model.effects.terms.types import Term


def found_terms(problem: Problem, description: Description, gap: Gap) -> tuple[FoundTerm, ...]:
    """The terms in words and numbers, in the order in which they were found.

    Args:
        problem: of the logs.
        description: what was found.
        gap: without and with it.
    """
    if not description.steps:
        return ()
    described = description.steps[-1].described
    spread = np.sqrt(np.maximum(np.diag(covariance(problem, described.fit)), 0))
    row, total = len(description.kept.columns.moving), max(gap.before_sigmas**2 - 1, 1e-12)
    found = []
    for step, term, scales in zip(description.steps, described.terms, described.scales, strict=True):
        stderr = scales * spread[row : row + len(scales)]
        row += len(scales)
        share = float(np.clip(step.share / total, 0, 1))
        curve = curve_of(problem, description, term)
        found.append(
            _found(term, stderr, share, _rms(term, gap, share), step.rivals)._replace(
                held_out_gain=step.held.nats, held_out_gain_stderr=step.held.nats_stderr, curve=curve
            )
        )
    return tuple(found)


def _rms(term: Term, gap: Gap, share: float) -> str:
    """How large a term's part of the reading is, by its share of the gap, with its unit."""
    group, unit = (slice(3, 6), "Nm") if term.acts_as == "torque" else (slice(0, 3), "N")
    removed = np.maximum(gap.before_rms[group] ** 2 - gap.noise_floor[group] ** 2, 0)
    return f"{np.sqrt(share * np.nanmean(removed)):.2g} {unit}"


def _found(term: Term, stderr: np.ndarray, share: float, rms: str, rivals: tuple[Term, ...]) -> FoundTerm:
    values = np.asarray(term.coefficients, float)
    count, names = len(values), [parameter.name for parameter in FORMS[term.drive, term.form].parameters]
    # A real cause never has quite the form, and no scatter of the data shows that.
    errors = np.hypot(stderr[:count], FORM_ERROR * np.abs(values))
    of_parameters = dict(zip(names, stderr[count:].tolist(), strict=False))
    words = DRIVE_WORDS[term.drive]
    text = sentence(term, values, errors, share)
    return FoundTerm(
        drive=term.drive,
        form=term.form,
        frame=term.frame,
        acts_as=term.acts_as,
        text=text,
        coefficients=grouped(term, values),
        stderr=grouped(term, errors),
        parameters={name: float(value) for name, value in term.parameters.items()},
        parameters_stderr=of_parameters,
        point=np.asarray(term.point, float).tolist() if has_point(term) else None,
        equivalent_to=tuple(rival.drive for rival in rivals),
        separate_by=tuple(DRIVE_WORDS[rival.drive].separate_by for rival in rivals),
        resembles=resembles(term),
        check=words.check,
        held_out_gain=0.0,
        held_out_gain_stderr=0.0,
        shrink=share,
        section=section_of(term, text),
        statement=statement(term, values, errors, rms),
    )
