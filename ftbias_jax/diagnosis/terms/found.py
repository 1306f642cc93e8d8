"""Terms of a description as the result tells them: numbers with standard errors, words, and what the plot shows."""

from __future__ import annotations

import numpy as np

from ftbias_jax.diagnosis.evidence.estimates import FORM_ERROR
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.fit import Fit, covariance
from ftbias_jax.diagnosis.result import Curve, FoundTerm, Gap
from ftbias_jax.diagnosis.terms.describe import Description
from ftbias_jax.diagnosis.terms.grid import free_names
from ftbias_jax.diagnosis.terms.phrases import DRIVE_WORDS, resembles
from ftbias_jax.diagnosis.terms.words import grouped, sentence, statement
from ftbias_jax.model.effects.terms.columns import added, at_point, has_point
from ftbias_jax.model.effects.terms.parse import section_of
from ftbias_jax.model.effects.terms.types import State, Term
from ftbias_jax.types import AXES, AXIS_UNITS

MOST_POINTS = 1500
"""Of a plot."""


def found_terms(problem: Problem, description: Description, gap: Gap) -> tuple[FoundTerm, ...]:
    """The terms in words and numbers, in the order in which they were found."""
    if not description.steps:
        return ()
    described = description.steps[-1].described
    spread = np.sqrt(np.maximum(np.diag(covariance(problem, described.fit)), 0))
    row, total = len(description.kept.columns.moving), max(gap.before_sigmas**2 - 1, 1e-12)
    found = []
    for step, term, scales in zip(description.steps, described.terms, described.scales, strict=True):
        stderr = scales * spread[row : row + len(scales)]
        row += len(scales)
        values, count = np.asarray(term.coefficients, float), len(term.coefficients)
        # A real cause never has quite the form, and no scatter of the data shows that.
        errors = np.hypot(stderr[:count], FORM_ERROR * np.abs(values))
        share = float(np.clip(step.share / total, 0, 1))
        one = found_term(
            term,
            errors,
            sentence(term, values, errors, share),
            statement(term, values, errors, _rms(term, gap, share)),
            (step.held.nats, step.held.nats_stderr),
        )
        one = one._replace(
            parameters_stderr=dict(zip(free_names(term), stderr[count:].tolist(), strict=False)),
            equivalent_to=tuple(rival.drive for rival in step.rivals),
            separate_by=tuple(DRIVE_WORDS[rival.drive].separate_by for rival in step.rivals),
            shrink=share,
            curve=_curve(problem, description.search.state, described.fit, term),
        )
        found.append(one)
    return tuple(found)


def found_term(term: Term, errors: np.ndarray, text: str, statement: str, gain: tuple[float, float]) -> FoundTerm:
    """A term in words and numbers, without rivals: errors (K,) of its coefficients, and its gain in nats/s with its."""
    return FoundTerm(
        drive=term.drive,
        form=term.form,
        frame=term.frame,
        acts_as=term.acts_as,
        text=text,
        coefficients=grouped(term, np.asarray(term.coefficients, float)),
        stderr=grouped(term, errors),
        parameters={name: float(value) for name, value in term.parameters.items()},
        parameters_stderr={},
        point=np.asarray(term.point, float).tolist() if has_point(term) else None,
        equivalent_to=(),
        separate_by=(),
        resembles=resembles(term),
        check=DRIVE_WORDS[term.drive].check,
        held_out_gain=gain[0],
        held_out_gain_stderr=gain[1],
        shrink=0.0,
        section=section_of(term, text),
        statement=statement,
    )


def _rms(term: Term, gap: Gap, share: float) -> str:
    """How large a term's part of the reading is, by its share of the gap, with its unit."""
    group, unit = (slice(3, 6), "Nm") if term.acts_as == "torque" else (slice(0, 3), "N")
    removed = np.maximum(gap.before_rms[group] ** 2 - gap.noise_floor[group] ** 2, 0)
    return f"{np.sqrt(share * np.nanmean(removed)):.2g} {unit}"


def _curve(problem: Problem, state: State, fit: Fit, term: Term) -> Curve:
    """The channel in which the term changes most, in units of its noise, against the drive."""
    made = np.asarray(added(np, term, state))
    channel = int((made / problem.noise_std).std(0).argmax())
    left = fit.error[:, channel] * np.sqrt(problem.variance[:, channel])
    seen = problem.samples[:, channel] > 0
    # The innovations are nearly white: what is left with the term, plus the term, is what was left without it.
    fitted = made[:, channel] - made[seen, channel].mean()
    if term.drive == "constant":  # what it follows is how its direction lies in the sensor
        drive, name = fitted, f"what the term makes of {AXES[channel]} [{AXIS_UNITS[channel]}]"
    else:
        drive, name = _drive(term, state, channel)
    thin = np.flatnonzero(seen)[:: max(1, int(seen.sum() / MOST_POINTS))]
    return Curve(drive[thin], name, (fitted - left)[thin], fitted[thin], f"{AXES[channel]} [{AXIS_UNITS[channel]}]")


def _drive(term: Term, state: State, channel: int) -> tuple[np.ndarray, str]:
    """(U,) the quantity that drives a term, and its name with the unit."""
    moved = at_point(np, state, np.asarray(term.point)) if has_point(term) else state
    axis = channel % 3
    letter = "xyz"[axis]
    joint = max(term.joint, 1)

    def inside(vectors: np.ndarray) -> np.ndarray:
        turned: np.ndarray = np.einsum("tj,tj->t", state.rotation[:, :, axis], vectors)
        return turned

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
