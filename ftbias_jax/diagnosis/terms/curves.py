"""The plot of a term: what was left of the reading against the drive, and what the term adds there."""

from __future__ import annotations

import numpy as np

from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.report.plotted import Curve
from ftbias_jax.diagnosis.terms.describe import Description
from ftbias_jax.model.effects.terms.columns import at_point, columns, has_point
from ftbias_jax.model.effects.terms.types import State, Term
from ftbias_jax.types import AXES, AXIS_UNITS

MOST_POINTS = 1500


def curve_of(problem: Problem, description: Description, term: Term) -> Curve:
    """The channel in which the term changes most, in units of its noise, against the drive."""
    state = description.search.state
    added = -np.einsum("ukc,k->uc", columns(np, term, state), np.asarray(term.coefficients))
    channel = int((added / problem.noise_std).std(0).argmax())
    fit: Fit = description.fit
    left = fit.error[:, channel] * np.sqrt(problem.variance[:, channel])
    seen = problem.samples[:, channel] > 0
    # The innovations are nearly white: what is left with the term, plus the term, is what was left without it.
    fitted = added[:, channel] - added[seen, channel].mean()
    if term.drive == "constant":  # what it follows is how its direction lies in the sensor
        drive, name = fitted, f"what the term makes of {AXES[channel]} [{AXIS_UNITS[channel]}]"
    else:
        drive, name = drive_of(term, state, channel)
    thin = np.flatnonzero(seen)[:: max(1, int(seen.sum() / MOST_POINTS))]
    return Curve(drive[thin], name, (fitted - left)[thin], fitted[thin], f"{AXES[channel]} [{AXIS_UNITS[channel]}]")


def drive_of(term: Term, state: State, channel: int) -> tuple[np.ndarray, str]:
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
