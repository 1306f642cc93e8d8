"""Action of a term on the reading: columns of regressors from motion, time and load, linear in its coefficients."""

from collections.abc import Mapping
from typing import Any

from ftbias_jax.model.effects.terms.forms import FORMS
from ftbias_jax.model.effects.terms.types import State, Term
from ftbias_jax.model.effects.types import Signals, motion_of
from ftbias_jax.model.kinematics.arm_batch import ArmMotion
from ftbias_jax.model.kinematics.recorded_pose import FreeBody
from ftbias_jax.model.kinematics.screws import Arm
from ftbias_jax.types import Array

MOVED = ("position", "velocity", "acceleration")
"""Drives that differ from one point of the tool to another; all of them are fields of the state."""
OF_JOINTS = ("joint_angle", "joint_velocity")
"""Drives that may refer to a single joint."""


def columns(xp: Any, term: Term, state: State) -> Array:
    """Columns (T, K, 6) N, Nm per coefficient of a term, sensor frame, that lower the reading; numpy or jax.numpy."""
    if acts_on_channels(term):
        series = channel_series(xp, term, state)
        found = (series[:, :, :, None] * xp.eye(6, dtype=series.dtype)[None, None]).reshape(len(series), -1, 6)
    else:
        found = _of_three(xp, term, vectors_of(xp, term, state))
    return found[:, list(term.used)] if term.used else found


def acts_on_channels(term: Term) -> bool:
    """Whether a term changes each channel of the sensor separately, and not as a force or a torque does."""
    kind = FORMS[term.drive, term.form].kind
    return kind == "channels" or (kind == "scalars" and term.frame == "sensor" and term.acts_as in ("wrench", "bias"))


def channel_series(xp: Any, term: Term, state: State) -> Array:
    """Series (T, S, 6) that act on the channels; there is one coefficient per series and channel, series by series."""
    series = _series(xp, term, state)
    if FORMS[term.drive, term.form].kind == "channels":
        return series[:, None]
    return xp.broadcast_to(series[:, :, None], (*series.shape, 6))


def vectors_of(xp: Any, term: Term, state: State) -> Array:
    """Forces or torques (T, V, 3) per coefficient, sensor frame, of a term that does not act on channels."""
    series = _series(xp, term, state)
    if FORMS[term.drive, term.form].kind == "vectors":
        return _along_axes(xp, term.frame, series, state.rotation)
    if term.frame == "joint":
        axis = xp.einsum("tji,tj->ti", state.rotation, state.axes[:, term.joint - 1])
        return series[:, :, None] * axis[:, None]
    # The rows are the axes in the sensor's coordinates.
    axes = xp.eye(3, dtype=series.dtype)[None] if term.frame == "sensor" else state.rotation
    return (series[:, :, None, None] * axes[:, None]).reshape(len(series), -1, 3)


def _series(xp: Any, term: Term, state: State) -> Array:
    """Series of a term's form, for the motion of the term's point and for its joint."""
    moves = term.drive in MOVED and has_point(term)
    seen = at_point(xp, state, term.point, ("position", "velocity", term.drive)) if moves else state
    if term.joint and term.drive in OF_JOINTS:
        own = slice(term.joint - 1, term.joint)
        seen = seen._replace(q=seen.q[:, own], dq=seen.dq[:, own])
    return FORMS[term.drive, term.form].make(xp, seen, term.parameters)


def count_columns(term: Term) -> int:
    """Number of columns of a term's form, whichever of them are used."""
    form = FORMS[term.drive, term.form]
    if form.kind == "channels":
        return 6
    if form.kind == "vectors":
        return form.series * (3 if term.frame == "sensor" and form.series == 1 else 1)
    if term.frame == "joint":
        return form.series
    return form.series * (6 if term.acts_as in ("wrench", "bias") else 3)


def _along_axes(xp: Any, frame: str, vectors: Array, rotation: Array) -> Array:
    """Vectors (T, V, 3) in base axes -> sensor axes; in the sensor's frame a single one is split into components."""
    inside = xp.einsum("tji,tvj->tvi", rotation, vectors)
    if frame != "sensor" or vectors.shape[1] > 1:
        return inside
    return (inside[:, :, :, None] * xp.eye(3, dtype=inside.dtype)[None, None]).reshape(len(inside), -1, 3)


def _of_three(xp: Any, term: Term, vectors: Array) -> Array:
    """(T, K, 3) forces or torques -> (T, K, 6)."""
    if term.acts_as == "torque":
        return torques(xp, vectors)
    forces = forces_at(xp, term.point, vectors)
    return xp.concatenate([forces, torques(xp, vectors)], 1) if term.acts_as == "wrench" else forces


def torques(xp: Any, vectors: Array) -> Array:
    """Pure torques (..., 3) Nm -> (..., 6) in the six channels."""
    return xp.concatenate([xp.zeros_like(vectors), vectors], -1)


def forces_at(xp: Any, point: Array, vectors: Array) -> Array:
    """Forces (..., 3) N at a point (3,) m of the tool, sensor frame -> (..., 6) in the six channels."""
    return xp.concatenate([vectors, _cross(xp, point, vectors)], -1)


def _cross(xp: Any, first: Array, second: Array) -> Array:
    """Cross products (..., 3); numpy's own function takes longer to arrange the axes than to multiply."""
    a, b, c = (first[..., i] for i in range(3))
    x, y, z = (second[..., i] for i in range(3))
    return xp.stack([b * z - c * y, c * x - a * z, a * y - b * x], -1)


def has_point(term: Term) -> bool:
    """Whether a term is a force at a point of the tool."""
    return term.acts_as == "force" or (term.acts_as == "wrench" and term.frame == "base")


def at_point(xp: Any, state: State, point: Array, fields: tuple[str, ...] = MOVED) -> State:
    """State with the given fields replaced by the motion of a point (3,) m of the tool, sensor frame."""
    arm = state.rotation @ point
    w, moved = state.angular_velocity, dict[str, Array]()
    if "position" in fields:
        moved["position"] = state.position + arm
    if "velocity" in fields:
        moved["velocity"] = state.velocity + _cross(xp, w, arm)
    if "acceleration" in fields:
        inward = _cross(xp, w, _cross(xp, w, arm))
        moved["acceleration"] = state.acceleration + _cross(xp, state.angular_acceleration, arm) + inward
    return state._replace(**moved)


def change(xp: Any, terms: Mapping[str, Term], state: State) -> Array:
    """Change (T, 6) N, Nm that terms add to the reading."""
    total = xp.zeros_like(state.load)
    for term in terms.values():
        if term.acts_as != "noise":
            total = total + added(xp, term, state)
    return total


def added(xp: Any, term: Term, state: State) -> Array:
    """Change (T, 6) N, Nm that one term adds to the reading: minus columns times coefficients, less the offset."""
    if acts_on_channels(term) or term.acts_as not in ("force", "torque"):
        return -xp.einsum("tkc,k->tc", columns(xp, term, state), term.coefficients) - term.offset[None]
    vectors = vectors_of(xp, term, state)
    vectors = vectors[:, list(term.used)] if term.used else vectors
    total = -xp.einsum("tvi,v->ti", vectors, term.coefficients)  # faster than by columns
    wrench = torques(xp, total) if term.acts_as == "torque" else forces_at(xp, term.point, total)
    return wrench - term.offset[None]


def noise_variance(xp: Any, terms: Mapping[str, Term], state: State) -> Array:
    """Variance (T, 6) N^2, Nm^2 that terms add to the noise."""
    total = xp.zeros_like(state.load)
    for term in terms.values():
        if term.acts_as == "noise":
            total = total + xp.einsum("tkc,k->tc", columns(xp, term, state), term.coefficients)
    return total


def state_of(
    xp: Any,
    signals: Signals,
    load: Array,
    motion: ArmMotion | None = None,
    counts: Array | None = None,
    period: float = 0.0,
) -> State:
    """State of a log from which the drives are computed, with numpy or jax.numpy.

    ``load`` (T, 6) N, Nm is the reading before the terms act. Every reading is the mean of ``counts`` (T,) samples that
    are ``period`` s apart; None = single samples.
    """
    moving = motion_of(signals) if motion is None else motion
    carrier: Arm | FreeBody = signals.model.arm
    as_array = xp.asarray
    q, dq = as_array(signals.q), as_array(signals.dq)
    if isinstance(carrier, FreeBody):  # The entries of a pose are not joints.
        q, dq, axes = q[:, :0], dq[:, :0], xp.zeros((len(q), 0, 3), q.dtype)
    else:
        axes = xp.einsum("ijnt,nj->tni", as_array(moving.link_rotation)[:, :, :-1], as_array(carrier.angular))
    return State(
        as_array(signals.t),
        as_array(signals.temperature),
        q,
        dq,
        xp.moveaxis(as_array(moving.sensor_rotation), 2, 0),
        as_array(moving.sensor_position).T,
        as_array(moving.velocity).T,
        as_array(moving.acceleration).T,
        as_array(moving.angular_velocity).T,
        as_array(moving.angular_acceleration).T,
        as_array(signals.model.gravity),
        as_array(load),
        axes,
        xp.ones_like(as_array(signals.t)) if counts is None else as_array(counts),
        as_array(period, dtype=dq.dtype),
    )
