"""Found terms as the result reports them: numbers with standard errors, words, what to check, and data for the plot."""

import re
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.evidence.estimates import FORM_ERROR
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.fit import Fit, covariance
from ftbias_jax.diagnosis.result import Curve, FoundTerm, Gap, Numbers
from ftbias_jax.diagnosis.terms import phrases
from ftbias_jax.diagnosis.terms.constant import without_constant
from ftbias_jax.diagnosis.terms.describe import Description
from ftbias_jax.diagnosis.terms.grid import free_names
from ftbias_jax.diagnosis.terms.select import is_gain_too
from ftbias_jax.model.effects.statements import value_words
from ftbias_jax.model.effects.terms.columns import added, at_point, count_columns, has_point
from ftbias_jax.model.effects.terms.forms import FORMS
from ftbias_jax.model.effects.terms.parse import section_of
from ftbias_jax.model.effects.terms.types import State, Term
from ftbias_jax.types import AXES, AXIS_UNITS

MOST_POINTS = 1500
"""Maximum number of points of a plot."""
LOADS = {"square": 2, "signed_square": 2, "cube": 3}
"""Form -> power of the load that it follows; 1 for all others that follow the load."""
UNITS = {("payload", ""): "kg", ("local", "dry"): "N"} | {("spring", axis): "N" for axis in "xyz"}
"""(form, series) -> unit of a coefficient that differs from that of the form's other series."""
POWERS = {"t2": 2, "q2": 2, "q3": 3, "squared": 2} | dict.fromkeys(("xx", "yy", "zz", "xy", "xz", "yz"), 2)
"""Series -> power of the form's unit; 1 for all others."""


def found_terms(problem: Problem, description: Description, gap: Gap) -> tuple[FoundTerm, ...]:
    """Terms in words and numbers, in the order in which they were found."""
    if not description.steps:
        return ()
    described, state = description.steps[-1].described, description.search.state
    spread = covariance(problem, described.fit)
    every_stderr = np.sqrt(np.maximum(np.diag(spread), 0))
    row, total = len(description.kept.columns.moving), max(gap.before_sigmas**2 - 1, 1e-12)
    found = []
    details = zip(description.steps, described.terms, described.scales, described.local_stderr, strict=True)
    for step, term, scales, local in details:
        numbers, row = slice(row, row + len(scales)), row + len(scales)
        stderr = scales * every_stderr[numbers]
        names = [name for name in free_names(term) if name not in local]
        late: dict[str, Numbers] = {name: np.squeeze(errors).tolist() for name, errors in local.items()}
        at: dict[str, Numbers] = {"point": stderr[-3:].tolist()} if has_point(term) else {}
        values, count = np.asarray(term.coefficients, float), len(term.coefficients)
        # A real cause never has exactly this form, which the scatter of the data does not reveal.
        errors = np.hypot(stderr[:count], FORM_ERROR * np.abs(values))
        share = float(np.clip(step.share / total, 0, 1))
        drives = [rival.drive for rival in step.rivals]
        drives += ["load"] if is_gain_too(term, state, problem.noise_std) else []
        rivals = tuple(dict.fromkeys(drives))
        term, of_reading = without_constant(term, state, spread[numbers, numbers], scales, problem.noise_std)
        one = found_term(
            term,
            errors,
            sentence(term, values, errors, share),
            statement(term, values, errors, _rms(term, gap, share)),
            (step.held.nats, step.held.nats_stderr),
        )
        one = one._replace(
            parameters_stderr=dict(zip(names, stderr[count:].tolist(), strict=False)) | late | at,
            equivalent_to=rivals,
            separate_by=tuple(phrases.DRIVE_WORDS[drive].separate_by for drive in rivals),
            shrink=share,
            reading_stderr=of_reading.tolist(),
            curve=_curve(problem, state, described.fit, term),
        )
        found.append(one)
    return tuple(found)


def found_term(term: Term, errors: np.ndarray, text: str, statement: str, gain: tuple[float, float]) -> FoundTerm:
    """Term in words and numbers, without rivals: errors (K,) of coefficients; gain in nats/s and its standard error."""
    return FoundTerm(
        drive=term.drive,
        form=term.form,
        frame=term.frame,
        acts_as=term.acts_as,
        text=text,
        coefficients=grouped(term, np.asarray(term.coefficients, float)),
        stderr=grouped(term, errors),
        parameters={name: np.asarray(value, float).tolist() for name, value in term.parameters.items()},
        parameters_stderr={},
        point=np.asarray(term.point, float).tolist() if has_point(term) else None,
        equivalent_to=(),
        separate_by=(),
        resembles=phrases.resembles(term, errors),
        check=phrases.check(term, errors),
        held_out_gain=gain[0],
        held_out_gain_stderr=gain[1],
        shrink=0.0,
        section=section_of(term, text),
        statement=statement,
    )


def _rms(term: Term, gap: Gap, share: float) -> str:
    """Rms of a term's part of the reading, derived from its share of the gap, with its unit."""
    removed = np.maximum(gap.before_rms**2 - gap.noise_floor**2, 0).reshape(2, 3)
    sizes = np.nanmean(removed / gap.noise_floor.reshape(2, 3) ** 2, 1)
    kind = {"force": 0, "torque": 1}.get(term.acts_as, int(np.nanargmax(sizes)))
    return f"{np.sqrt(share * np.nanmean(removed[kind])):.2g} {('N', 'Nm')[kind]}"


def _curve(problem: Problem, state: State, fit: Fit, term: Term) -> Curve:
    """Residual against the drive in the channel that the term changes most, in units of its noise."""
    made = np.asarray(added(np, term, state))
    channel = int((made / problem.noise_std).std(0).argmax())
    left = fit.error[:, channel] * np.sqrt(problem.variance[:, channel])
    seen = problem.samples[:, channel] > 0
    # The innovations are nearly white, so the residual with the term plus the term is the residual without it.
    fitted = made[:, channel] - made[seen, channel].mean()
    if term.drive == "constant":  # its drive is the orientation of its direction in the sensor
        drive, name = fitted, f"what the term makes of {AXES[channel]} [{AXIS_UNITS[channel]}]"
    else:
        drive, name = _drive(term, state, channel)
    thin = np.flatnonzero(seen)[:: max(1, int(seen.sum() / MOST_POINTS))]
    return Curve(drive[thin], name, (fitted - left)[thin], fitted[thin], f"{AXES[channel]} [{AXIS_UNITS[channel]}]")


def _drive(term: Term, state: State, channel: int) -> tuple[np.ndarray, str]:
    """(U,) quantity that drives a term, and its name with the unit."""
    moved = at_point(np, state, np.asarray(term.point)) if has_point(term) else state
    axis = channel % 3
    letter = "xyz"[axis]
    joint = max(term.joint, 1)

    def inside(vectors: np.ndarray) -> np.ndarray:
        return np.einsum("tj,tj->t", state.rotation[:, :, axis], vectors)

    match term.drive:
        case "velocity":
            return inside(moved.velocity), f"velocity along {letter} of the sensor [m/s]"
        case "acceleration":
            return inside(moved.acceleration), f"acceleration along {letter} of the sensor [m/s^2]"
        case "angular_velocity":
            return inside(state.angular_velocity), f"angular velocity about {letter} of the sensor [rad/s]"
        case "position":
            widest = int(np.ptp(moved.position, axis=0).argmax())
            return moved.position[:, widest], f"place of the tool along {'xyz'[widest]} of the base [m]"
        case "orientation":
            down = inside(np.broadcast_to(state.gravity / np.linalg.norm(state.gravity), state.position.shape))
            return down, f"gravity along {letter} of the sensor [1]"
        case "joint_angle":
            return state.q[:, joint - 1], f"angle of joint {joint} [rad]"
        case "joint_velocity" if term.form != "heat":
            return state.dq[:, joint - 1], f"speed of joint {joint} [rad/s]"
        case "load":
            return state.load[:, channel], f"load in {AXES[channel]} [{AXIS_UNITS[channel]}]"
        case "temperature":
            return state.temperature, "temperature [deg C]"
        case "frequency":
            phase = np.mod(state.t * float(term.parameters["frequency"]), 1.0)
            return phase, f"phase at {float(term.parameters['frequency']):.4g} Hz [turns]"
        case _:
            return state.t, "time [s]"


class Coefficient(NamedTuple):
    """What a coefficient of a term belongs to."""

    series: str
    """Name of the series, such as "sin"; "" if there is only one."""
    axis: str
    """Name of the channel, such as "fx"; "" if it acts along more than one."""
    unit: str
    """Unit in words, such as ``N per m/s``."""


def coefficients_of(term: Term) -> list[Coefficient]:
    """Series, axis and unit of every coefficient in use."""
    form = FORMS[term.drive, term.form]
    single = form.kind == "vectors" and not (term.frame == "sensor" and form.series == 1)
    found = []
    for column in list(term.used) or range(count_columns(term)):
        series, channel = _place(term, column)
        label = form.labels[series]
        unit = _unit_of_load(term, channel) if form.kind == "channels" else _unit(term, label, channel)
        found.append(Coefficient(label, "" if single or term.frame == "joint" else AXES[channel], unit))
    return found


def _place(term: Term, column: int) -> tuple[int, int]:
    """Index of the form's series that a column belongs to, and of the channel it acts on (the first for vectors)."""
    form = FORMS[term.drive, term.form]
    torque = 3 * (term.acts_as == "torque")
    if form.kind == "channels":
        return 0, column
    if form.kind == "vectors" or term.frame == "joint":
        single = form.kind == "vectors" and form.series == 1
        return 0 if single else column, torque or column % 3
    if term.acts_as not in ("wrench", "bias"):
        return column // 3, torque + column % 3
    if term.frame == "sensor":
        return column // 6, column % 6
    half = 3 * form.series
    return (column % half) // 3 if term.acts_as == "wrench" else column // 6, column % 3 + 3 * (column >= half)


def _unit_of_load(term: Term, channel: int) -> str:
    """Unit of a coefficient that maps a channel's own load to its reading or its noise variance."""
    form, own = FORMS[term.drive, term.form], AXIS_UNITS[channel]
    if term.drive == "noise":
        return f"{own}^2 per {f'{own}^2' if form.name == 'load' else form.unit}"
    power = LOADS.get(form.name, 1)
    load = own if power == 1 else f"{own}^{power}"
    return f"{own} per {load}" + ("" if term.drive == "load" or form.unit == "1" else f" {form.unit}")


def _unit(term: Term, series: str, channel: int) -> str:
    form, own = FORMS[term.drive, term.form], AXIS_UNITS[channel]
    if (form.name, series) in UNITS:
        return UNITS[form.name, series]
    per = f"{form.unit}^{POWERS[series]}" if series in POWERS else form.unit
    return own if form.unit == "1" else f"{own} per {per}"


def grouped(term: Term, values: np.ndarray) -> dict[str, Numbers]:
    """Coefficients by unit, as in the JSON: a number, or a list along the axes."""
    found: dict[str, list[Numbers]] = {}
    for one, value in zip(coefficients_of(term), values, strict=True):
        key = _key("_".join(part for part in (one.series, one.unit) if part))
        found.setdefault(key, []).append(float(value))
    return {key: numbers[0] if len(numbers) == 1 else numbers for key, numbers in found.items()}


def _key(text: str) -> str:
    """Unit as part of a name: ``N per m/s`` -> ``N_per_m_s``, ``N per (m/s)^2`` -> ``N_per_m2_s2``."""
    text = text.replace("(m/s^2)^2", "m2 s4")
    text = re.sub(r"\((\w+)/s\)\^(\d)", r"\1\2 s\2", text)
    return text.replace("^", "").replace("/", "_").replace(" ", "_")


def sentence(term: Term, values: np.ndarray, stderr: np.ndarray, share: float) -> str:
    """Such as ``a force of 23.6 +- 0.4 N per m/s against the velocity of the tool, in base axes (92 % of the gap)``."""
    where = {"base": ", in base axes", "sensor": ", in sensor axes", "joint": ", about the joint's axis"}
    size = f"{_what(term, signed=True)} of {_size(term, values, stderr)}".replace("±", "+-")
    return f"{size} {_does(term)}{where.get(term.frame, '')} ({100 * share:.0f} % of the gap)"


def statement(term: Term, values: np.ndarray, stderr: np.ndarray, rms: str) -> str:
    """Description for a headline; several coefficients are summarised by their ``rms``, or the length of a force."""
    if phrases.is_shift(term, stderr):
        return phrases.shift(term, _size(term, values, stderr))
    size, units = f"about {rms}", [one.unit for one in coefficients_of(term)]
    if term.drive == "time" and {*units} <= {"N", "Nm"}:  # the rms over the whole log says little about its part
        unit = "N" if "N" in units else "Nm"
        size = f"about {np.linalg.norm(values[[each == unit for each in units]]):.2g} {unit}"
    size = _size(term, values, stderr) if len(values) == 1 else size
    return f"{_what(term, signed=len(values) == 1)} of {size} {_does(term)}"


def _what(term: Term, *, signed: bool) -> str:
    """What a term is; ``signed`` if its coefficients follow, which lower the reading unless the load drives them."""
    if term.acts_as == "wrench" and term.frame == "sensor":
        lowers = signed and not term.drive.startswith("load")
        return "a correction to add to the reading" if lowers else "a change of the reading"
    if term.form == "payload":
        return "a load"
    return {"force": "a force", "torque": "a torque", "wrench": "a force and torque", "bias": "a bias"}[term.acts_as]


def _does(term: Term) -> str:
    """What the term follows, with the parameters of its form filled in."""
    numbers = {name: float(value) for name, value in term.parameters.items() if np.size(value) == 1}
    if "frequency" in numbers:
        numbers["period"] = 1 / max(numbers["frequency"], 1e-9)
    spells = phrases.intervals_in_words(term.parameters["time"]) if "time" in term.parameters else ""
    joints = f"joint {term.joint}" if term.joint else "all joints"
    return phrases.FORM_WORDS[term.drive, term.form].format(**numbers, joint=term.joint, joints=joints, spells=spells)


def _size(term: Term, values: np.ndarray, stderr: np.ndarray) -> str:
    """Most significant coefficient, or all of them if they are few."""
    of = coefficients_of(term)
    words = [value_words(float(value), float(error)) for value, error in zip(values, stderr, strict=True)]
    if len(values) == 1:
        return f"{words[0]} {of[0].unit}"
    if len(values) <= 3 and len({one.unit for one in of}) == 1:
        return f"({', '.join(words)}) {of[0].unit}"
    surest = int(np.argmax(np.abs(values) / np.maximum(stderr, 1e-12)))
    name = f"{of[surest].series} {of[surest].axis}".strip()
    return f"{words[surest]} {of[surest].unit} ({name}, the surest of {len(values)} numbers)"
