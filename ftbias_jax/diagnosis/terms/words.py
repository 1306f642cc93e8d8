"""A term in words and numbers: what acts, how much, what it resembles, and what to check on the robot."""

from __future__ import annotations

import re

import numpy as np

from ftbias_jax.diagnosis.result import Numbers
from ftbias_jax.diagnosis.terms.phrases import FORM_WORDS, PER
from ftbias_jax.model.effects.statements import value_words
from ftbias_jax.model.effects.terms.columns import count_columns
from ftbias_jax.model.effects.terms.forms import FORMS
from ftbias_jax.model.effects.terms.types import Term
from ftbias_jax.types import AXES, AXIS_UNITS


def units_of(term: Term) -> list[str]:
    """The unit of every coefficient in use, in words such as ``N per m/s``."""
    whole = [_unit(term, k) for k in range(count_columns(term))]
    used = list(term.used) or range(len(whole))
    return [whole[k] for k in used]


LOADS = {"square": 2, "signed_square": 2, "cube": 3}
"""Form -> the power of the load that it follows; 1 of all others that follow the load."""


def _unit_of_channel(term: Term, channel: int) -> str:
    """The unit of a coefficient that makes a channel's reading, or its variance, of the channel's own load."""
    form = FORMS[term.drive, term.form]
    own = AXIS_UNITS[channel]
    if term.drive == "noise":
        return f"{own}^2 per {f'{own}^2' if form.name == 'load' else form.unit}"
    power = LOADS.get(form.name, 1)
    load = own if power == 1 else f"{own}^{power}"
    beside = "" if term.drive == "load" or form.unit == "1" else f" {form.unit}"
    return f"{own} per {load}{beside}"


def _unit(term: Term, column: int) -> str:
    form = FORMS[term.drive, term.form]
    if form.kind == "channels":
        return _unit_of_channel(term, column)
    per = PER.get(form.unit, form.unit)
    label = form.labels[_series(term, column)]
    if form.name == "spring":
        return "N per m" if label == "stiffness" else "N"
    if form.name in ("gyroscopic",):
        return "Nm per rad/s"
    if label in ("t2",):
        per = "s^2"
    if form.name == "cubic" and term.drive == "joint_angle":
        per = {"q": "rad", "q2": "rad^2", "q3": "rad^3"}[label]
    if (
        form.name == "quadratic"
        and term.drive in ("position", "temperature")
        and label not in ("x", "y", "z", "linear")
    ):
        per = f"{per}^2"
    quantity = AXIS_UNITS[_channel(term, column)]
    return f"{quantity} per {per}" if per else quantity


def _series(term: Term, column: int) -> int:
    """Which of the form's series a column belongs to."""
    form = FORMS[term.drive, term.form]
    if form.kind != "scalars":
        return column if form.series > 1 else 0
    if term.frame == "joint":
        return column
    half = 3 * form.series
    if term.acts_as == "wrench" and term.frame != "sensor":
        return (column % half) // 3
    return column // (6 if term.acts_as in ("wrench", "bias") else 3)


def _channel(term: Term, column: int) -> int:
    """0 to 5: the force's or torque's axis that a column acts along; the first of them for vectors."""
    form = FORMS[term.drive, term.form]
    if form.kind == "channels":
        return column
    if term.acts_as == "torque":
        return 3 + (column % 3 if form.kind == "scalars" and term.frame != "joint" else 0)
    if term.acts_as in ("wrench", "bias"):
        if term.frame == "sensor":
            return column % 6
        return column % 3 + 3 * (column >= 3 * form.series)
    return column % 3


def labels_of(term: Term) -> list[tuple[str, str]]:
    """Series and axis of every coefficient in use, such as ("sin", "fx"); "" where there is nothing to tell."""
    form = FORMS[term.drive, term.form]
    single = form.kind == "vectors" and not (term.frame == "sensor" and form.series == 1)
    alone = single or term.frame == "joint"
    return [
        (form.labels[_series(term, k)], "" if alone else AXES[_channel(term, k)])
        for k in list(term.used) or range(count_columns(term))
    ]


def grouped(term: Term, values: np.ndarray) -> dict[str, Numbers]:
    """Coefficients by unit, as the JSON has them: a number, or a list along the axes."""
    found: dict[str, list[Numbers]] = {}
    for (series, _), unit, value in zip(labels_of(term), units_of(term), values, strict=True):
        key = _key("_".join(part for part in (series, unit) if part))
        found.setdefault(key, []).append(float(value))
    return {key: numbers[0] if len(numbers) == 1 else numbers for key, numbers in found.items()}


def _key(text: str) -> str:
    """A unit as part of a name: ``N per m/s`` -> ``N_per_m_s``, ``N per (m/s)^2`` -> ``N_per_m2_s2``."""
    text = text.replace("(m/s^2)^2", "m2 s4")
    text = re.sub(r"\((\w+)/s\)\^(\d)", r"\1\2 s\2", text)
    return text.replace("^", "").replace("/", "_").replace(" ", "_")


def sentence(term: Term, values: np.ndarray, stderr: np.ndarray, share: float) -> str:
    """Such as ``a force of 23.6 +- 0.4 N per m/s against the velocity of the tool, in base axes (92 % of the gap)``."""
    what, does = _what(term), _does(term)
    where = {"base": ", in base axes", "sensor": ", in sensor axes", "joint": ", about the joint's axis"}
    size = _size(term, values, stderr)
    return f"{what} of {size} {does}{where.get(term.frame, '')} ({100 * share:.0f} % of the gap)"


def statement(term: Term, values: np.ndarray, stderr: np.ndarray, rms: str) -> str:
    """The same without frame and share, for a headline; of several numbers only what they add up to.

    Args:
        term: the term.
        values: (k,) its coefficients.
        stderr: (k,) their standard errors.
        rms: how large its part of the reading is, with its unit.
    """
    size = f"about {rms}"
    if len(values) == 1:
        size = f"{value_words(float(values[0]), float(stderr[0]))} {units_of(term)[0]}"
    return f"{_what(term)} of {size} {_does(term)}"


def _what(term: Term) -> str:
    if term.acts_as == "wrench" and term.frame == "sensor":
        return "a change of the reading"
    return {"force": "a force", "torque": "a torque", "wrench": "a force and torque", "bias": "a bias"}[term.acts_as]


def _does(term: Term) -> str:
    """What it follows, with the numbers of its form filled in."""
    numbers = {name: float(value) for name, value in term.parameters.items()}
    if "frequency" in numbers:
        numbers["period"] = 1 / max(numbers["frequency"], 1e-9)
    joints = f"joint {term.joint}" if term.joint else "all joints"
    return FORM_WORDS[term.drive, term.form].format(**numbers, joint=term.joint, joints=joints)


def _size(term: Term, values: np.ndarray, stderr: np.ndarray) -> str:
    """The largest coefficient, or all of them if they are few."""
    units, labels = units_of(term), labels_of(term)
    if len(values) == 1:
        return f"{value_words(float(values[0]), float(stderr[0]))} {units[0]}".replace("±", "+-")
    if len(values) <= 3 and len(set(units)) == 1:
        numbers = ", ".join(value_words(float(v), float(e)) for v, e in zip(values, stderr, strict=True))
        return f"({numbers}) {units[0]}".replace("±", "+-")
    largest = int(np.argmax(np.abs(values) / np.maximum(stderr, 1e-12)))
    name = " ".join(labels[largest]).strip()
    words = f"{value_words(float(values[largest]), float(stderr[largest]))} {units[largest]}"
    return f"{words} ({name}, the surest of {len(values)} numbers)".replace("±", "+-")
