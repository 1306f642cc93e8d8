"""The ``[[effects.term]]`` sections of a setup: any number of terms, each with its drive, form and numbers."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ftbias_jax.errors import FtbiasError, SetupError
from ftbias_jax.model.effects.terms.columns import OF_JOINTS, count_columns, has_point
from ftbias_jax.model.effects.terms.forms import DRIVES, FORMS
from ftbias_jax.model.effects.terms.types import ACTS_AS, FRAMES, Parameter, Term
from ftbias_jax.setup.fields import nearest, show

TERM = "term"
"""Key of the terms among the effects of a setup."""
FIXED = ("drive", "form", "frame", "acts_as", "joint", "columns", "point", "coefficients", "offset", "text")

BY_CLOCK = ("time", "load_time", "frequency")
"""Drives of terms that depend on the time since the first sample of their log."""

MakeError = Callable[..., FtbiasError]
"""(message, field=..., remedy=...) -> the error to raise."""


def parse_terms(sections: Any, error: MakeError = SetupError) -> dict[str, Term]:
    """Terms of ``effects["term"]`` of a setup, keyed by the number of their section, from 1.

    Raises:
        SetupError: an unknown drive, form or key, a missing or wrong number.
    """
    if not isinstance(sections, Sequence) or not all(isinstance(section, Mapping) for section in sections):
        raise error(f"expected tables, got {show(sections)}", field="effects.term", remedy="write [[effects.term]]")
    return {str(i): _term(section, i, error) for i, section in enumerate(sections, 1)}


def goes_by_clock(section: Mapping[str, Any]) -> bool:
    """Whether a term depends on the time since the first sample of its log."""
    return section["drive"] in BY_CLOCK or "time" in section


def _term(section: Mapping[str, Any], number: int, error: MakeError) -> Term:
    def fail(key: str, message: str, remedy: str) -> FtbiasError:
        return error(message, field=f"effects.term[{number}].{key}", remedy=remedy)

    def choice(key: str, allowed: Sequence[str]) -> str:
        value = section.get(key)
        if value not in allowed:
            message = "missing key" if value is None else f"got {show(value)}"
            raise fail(key, message, nearest(str(value), allowed))
        return str(value)

    def numbers(key: str, size: int, several: bool = False) -> np.ndarray:
        value = np.asarray(section.get(key, np.nan))
        right = value.size == size or (several and value.ndim == 1 and value.size > size)
        if value.dtype.kind not in "iuf" or not right or not np.isfinite(value).all():
            message = f"got {show(section[key])}" if key in section else "missing key"
            raise fail(key, message, f"give {size} number{'s' if size > 1 else ''}{' or more' if several else ''}")
        return value.astype(float).reshape(-1)

    def parameter(own: Parameter) -> np.ndarray:
        value = numbers(own.name, 1, own.several)
        if not ((own.least <= value) & (value <= own.most)).all():
            remedy = f"give {own.unit} from {own.least:g} to {own.most:g}"
            raise fail(own.name, f"got {show(section[own.name])}", remedy)
        if (np.diff(value) <= 0).any():
            raise fail(own.name, f"got {show(section[own.name])}", "give ascending numbers")
        return value if value.size > 1 else value[0]

    drive = choice("drive", DRIVES)
    form = FORMS[drive, choice("form", [name for own, name in FORMS if own == drive])]
    known = (*FIXED, *(own.name for own in form.parameters))
    for key in section:
        if key not in known:
            raise fail(key, "unknown key", nearest(key, known))
    parameters = {own.name: parameter(own) for own in form.parameters}
    joint = int(numbers("joint", 1)[0]) if "joint" in section else 0
    used = tuple(int(x) for x in np.ravel(section.get("columns", ())))
    term = Term(
        drive,
        form.name,
        choice("frame", FRAMES),
        choice("acts_as", ACTS_AS),
        joint,
        used,
        parameters,
        numbers("point", 3) if "point" in section else np.zeros(3),
        np.zeros(0),
    )
    if joint < 0 or (drive in OF_JOINTS and not joint and form.name != "heat"):
        raise fail("joint", f"got {joint}", "give the number of a joint, from 1")
    count = count_columns(term)
    if any(not 0 <= column < count for column in used):
        raise fail("columns", f"got {show(list(used))}", f"give numbers from 0 to {count - 1}")
    offset = numbers("offset", 6) if "offset" in section else np.zeros(6)
    return replace(term, coefficients=numbers("coefficients", len(used) or count), offset=offset)


def section_of(term: Term, text: str = "") -> dict[str, Any]:
    """Section of a setup that states a term."""
    section: dict[str, Any] = {"text": text} if text else {}
    section |= {"drive": term.drive, "form": term.form, "frame": term.frame, "acts_as": term.acts_as}
    section |= {"joint": term.joint} if term.joint else {}
    section |= {name: np.asarray(value, float).tolist() for name, value in term.parameters.items()}
    section |= {"columns": list(term.used)} if term.used else {}
    section |= {"point": np.asarray(term.point, float).tolist()} if has_point(term) else {}
    section |= {"coefficients": np.asarray(term.coefficients, float).tolist()}
    return section | ({"offset": np.asarray(term.offset, float).tolist()} if np.any(term.offset) else {})


def flat_numbers(terms: Mapping[str, Term]) -> dict[str, Any]:
    """Numeric values of terms by name: ``1.coefficients``, ``1.point``, ``1.time_constant``, ..."""
    return {
        f"{number}.{name}": value
        for number, term in terms.items()
        for name, value in {"coefficients": term.coefficients, "point": term.point, **term.parameters}.items()
    }
