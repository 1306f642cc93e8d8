"""A diagnosis as JSON, for programs."""

import os
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ftbias_jax.diagnosis.result import Candidate, Course, Diagnosis, FoundTerm
from ftbias_jax.errors import LogError
from ftbias_jax.io.atomic import plain, read_json, write_json

SCHEMA = 2


def save_json(diagnosis: Diagnosis, path: str | os.PathLike[str]) -> None:
    """Write a diagnosis without the series of its plots as JSON, atomically; ``Diagnosis.to_json`` is bound to this.

    Raises:
        OutputError: the file cannot be written there.
    """
    write_json(path, to_json(diagnosis))


def to_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """The diagnosis as plain dicts, lists, strings and finite numbers, for programs; None where there is no number."""
    where, gap = diagnosis.where, diagnosis.gap
    content = {
        "schema": SCHEMA,
        "verdict": diagnosis.verdict,
        "sentence": diagnosis.sentence,
        "note": diagnosis.note,
        "causes": [cause._asdict() for cause in diagnosis.causes],
        "posterior": {"correlation": diagnosis.correlations},
        "tool_stderr": dict(diagnosis.tool_stderr),
        "model_stderr": diagnosis.model_stderr,
        "terms": [{key: value for key, value in term._asdict().items() if key != "curve"} for term in diagnosis.terms],
        "gap": {
            "before": {"rms": gap.before_rms, "in_noise_sigmas": gap.before_sigmas},
            "after": {"rms": gap.after_rms, "in_noise_sigmas": gap.after_sigmas},
            "shrink": gap.shrink,
            "shrink_stderr": gap.shrink_stderr,
            "noise_floor": gap.noise_floor,
        },
        "where": where._asdict() | {"regimes": [regime._asdict() for regime in where.regimes]},
        "candidates": [candidate._asdict() for candidate in diagnosis.candidates],
        "not_tested": dict(diagnosis.not_tested),
        "logs": diagnosis.logs,
        "provenance": diagnosis.provenance,
        "losses": diagnosis.losses,
        "by_log": [log._asdict() for log in diagnosis.by_log],
        "courses": [course._asdict() for course in diagnosis.courses],
    }
    return plain(content)


def load_found(path: str) -> tuple[tuple[Candidate, ...], tuple[FoundTerm, ...], dict[str, Any]]:
    """Causes and terms of a diagnosis that was saved as JSON, and its whole content.

    Raises:
        LogError: the file cannot be read, or is no diagnosis.
    """
    content = read_json(path, "a diagnosis")
    try:
        causes = tuple(Candidate(**_fields(cause, Candidate._fields)) for cause in content["causes"])
        terms = tuple(FoundTerm(**_fields(term, FoundTerm._fields)) for term in content["terms"])
    except (KeyError, TypeError, AttributeError) as error:
        remedy = "give what ftbias diagnose --json writes"
        raise LogError(f"is no diagnosis: {error!r}", file=path, remedy=remedy) from error
    return causes, terms, content


def load_courses(path: str) -> tuple[str, tuple[Course, ...]]:
    """Name of the setup of a saved diagnosis of pooled logs, and the time courses of its causes.

    Raises:
        LogError: the file cannot be read, or is no such diagnosis.
    """
    content = read_json(path, "a diagnosis")
    try:
        courses = tuple(Course(**course) for course in content["courses"])
        arrays = [[np.array(x, float) for x in (one.dates, one.share, one.stderr)] for one in courses]
        if any(len({x.shape for x in some}) > 1 or some[0].ndim != 1 or not len(some[0]) for some in arrays):
            raise ValueError("dates and shares do not match")
        return str(content["provenance"]["setup"]["name"]), tuple(
            one._replace(dates=dates, share=share, stderr=stderr)
            for one, (dates, share, stderr) in zip(courses, arrays, strict=True)
        )
    except (KeyError, TypeError, ValueError) as error:
        remedy = "give what ftbias diagnose --pool by=robot --json writes"
        raise LogError(f"is no diagnosis of pooled logs: {error!r}", file=path, remedy=remedy) from error


def _fields(entry: Mapping[str, Any], names: Iterable[str]) -> dict[str, Any]:
    return {name: entry[name] for name in names if name in entry}
