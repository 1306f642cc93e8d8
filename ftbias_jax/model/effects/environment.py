"""Effects of the environment stage: forces on the tool besides gravity, and a tool that is not rigid.

A force F that the environment exerts on the tool lowers the reading by F, because the sensor has less to hold.
"""

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.model.effects.fitting import INVERSE, LOGARITHM, Coordinate, Fitting, Pull, Ringing, Touches
from ftbias_jax.model.effects.responses import decay_time, rung
from ftbias_jax.model.effects.statements import amount, events
from ftbias_jax.model.effects.types import Effect, EffectValues, Model, Parameter, Signals, Twin, motion_of, within
from ftbias_jax.model.kinematics.recorded_pose import FreeBody
from ftbias_jax.model.kinematics.screws import Arm
from ftbias_jax.model.wrench.inertia import about_center_of_mass, center_of_mass, spatial_inertia
from ftbias_jax.types import Array


def tool_flexibility(values: EffectValues, signals: Signals, wrench: Array) -> Array:
    """Flexible tool: a part of it is mounted on springs, oscillates relative to the sensor and sags under its weight.

    There is one mode for each of the three translations along and rotations about the sensor's axes. Let w (6,) be the
    wrench of the rigid tool, M (6, 6) its spatial inertia about the sensor's origin, s_k the share of the tool that
    moves in mode k, x_k its displacement. Spring and damper of a mode, whose force the sensor reads, carry this part:
    -s_k M_kk (W^2 x_k + 2 zeta W x_k') = s_k (w_k + M_kk x_k''), so their force is the second-order response of w_k
    (``rung``), M_kk x_k'' = rung(w_k) - w_k whatever the share, and the accelerations of all modes together change the
    reading by M s x''. Coupling between modes is neglected.

    Sagging moves the point c at which the force F acts, which adds the torque (x_shift + x_turn x c) x F to w. It is
    small, so three rounds of substitution converge; the damper's contribution to x is neglected here.
    """
    theta, share = signals.model.theta, values["share"]
    M = spatial_inertia(theta)
    inertia = jnp.maximum(jnp.diagonal(M), np.finfo(theta.dtype).tiny)[None]
    compliance = values["sagging"] * share[None] / (inertia * (2 * jnp.pi * values["frequency"]) ** 2)
    spring = wrench
    for _ in range(3):
        sag = -spring * compliance
        moved = sag[:, :3] + jnp.cross(sag[:, 3:], about_center_of_mass(theta)[1][None])
        sagged = wrench + jnp.pad(jnp.cross(moved, wrench[:, :3]), ((0, 0), (3, 0)))
        spring = rung(signals.t, sagged, values["frequency"], values["damping_ratio"])
    return sagged + (share[None] * (spring - sagged) / inertia) @ M.T


def _about_xy(model: Model) -> Array:
    return np.array([0, 0, 0, 1, 1, 0], model.theta.dtype)


_SPRINGS = Coordinate(INVERSE, lower=3.5, upper=1e3)
"""Hz; softer springs would sag by 2 cm under the tool's weight, so a slower oscillation is a hanging part or a liquid.
A tool that rings faster than the upper bound is rigid; there, unlike at infinite frequency, derivatives are finite."""
_DAMPING = Coordinate(LOGARITHM, scale=1.0, lower=1e-3, upper=0.25)
"""Share of critical damping; with more than a quarter of it a part rings too little to be a tool on springs."""
_FREE = Coordinate(scale=1.0, zero=0.0)
"""No part of a rigid tool moves, whatever the shares, so a fit need not start at their neutral values."""
_LINKED = Coordinate(scale=0.03)
"""m; typical departure of a cable's near end from its neutral place."""
_FREQUENCIES = tuple(np.geomspace(3.6, 30.0, 12).tolist())
"""Hz; initial frequencies of a search."""

FLEXIBILITY = (
    Effect(
        "tool_flexibility",
        "environment",
        (
            Parameter(
                "frequency",
                "Hz",
                "of the tool on its springs, undamped",
                **within((), 1.0, np.inf, np.inf, 10.0, search=True, starts=_FREQUENCIES, coordinate=_SPRINGS),
            ),
            Parameter(
                "damping_ratio",
                "1",
                "share of critical damping",
                **within((), 0.0, 0.99, 0.05, 0.0, search=True, coordinate=_DAMPING),
            ),
            Parameter(
                "share",
                "1",
                "of the tool that moves: shifts along, turns about the sensor's axes; default: all of it about x and y",
                **within((6,), 0.0, 2.0, _about_xy, 0.0, search=True, optional=True, coordinate=_FREE),
            ),
            Parameter(
                "sagging",
                "1",
                "1 if the tool's weight bends the springs, 0 if it is balanced",
                **within((), 0.0, 1.0, 1.0, 0.0, search=True, optional=True, coordinate=_FREE),
            ),
        ),
        "the tool or its mounting swings at one frequency after accelerations",
        "tighten or stiffen the tool, or move more smoothly",
        reading=tool_flexibility,
        forgets=lambda values: decay_time(values["frequency"], values["damping_ratio"]),
        needs_motion="acceleration",
        fit=Fitting(Ringing(), any_shape=True),
        twins=(
            Twin("tool_inertia", False, "accelerate the wrist at several frequencies"),
            Twin("time_delay", False, "accelerate sharply: a flexible tool rings"),
        ),
        statement=amount("the tool rings at {value} Hz", "frequency"),
    ),
)
"""Acts on the tool's own wrench, before other forces act on the tool."""


def cable(values: EffectValues, signals: Signals, wrench: Array) -> Array:
    """An elastic cable between the tool and a point of a link or of the world; it pulls and never pushes."""
    span = cable_span(values, signals)
    length = jnp.sqrt(jnp.maximum((span**2).sum(1), np.finfo(span.dtype).tiny))
    tension = values["stiffness"] * jnp.maximum(length - values["rest_length"], 0)
    force = (tension / length)[:, None] * span
    return wrench - jnp.concatenate([force, jnp.cross(values["attachment"][None], force)], 1)


def cable_span(values: EffectValues, signals: Signals) -> Array:
    """Vector (T, 3) m, sensor frame, from a cable's near end to its far end."""
    motion = motion_of(signals)
    link = jnp.clip(jnp.round(values["link"]), 0, signals.q.shape[1]).astype(int)
    anchor = jnp.einsum("ijt,j->it", motion.link_rotation[:, :, link], values["anchor"]) + motion.link_position[:, link]
    tool = jnp.einsum("ijt,j->it", motion.sensor_rotation, values["attachment"]) + motion.sensor_position
    return jnp.einsum("jit,jt->ti", motion.sensor_rotation, anchor - tool)


def contact(values: EffectValues, signals: Signals, wrench: Array) -> Array:
    """Temporary contacts: half sines of force, with directions fixed in the base frame, at points of the tool."""
    start, end = values["start"], values["end"]
    lasting = jnp.where(end > start, end - start, 1)
    phase = (signals.t[:, None] - start[None]) / lasting[None]
    touching = (phase > 0) & (phase < 1) & (end > start)[None]
    size = jnp.where(touching, jnp.sin(jnp.pi * jnp.clip(phase, 0, 1)), 0)

    def push(R_base_sensor: Array, size: Array) -> Array:
        force = size[:, None] * values["force"] @ R_base_sensor
        torque = jnp.cross(values["point"], force)
        return jnp.concatenate([force.sum(0), torque.sum(0)])

    return wrench - jax.vmap(push, (2, 0))(motion_of(signals).sensor_rotation, size)


def _center_of_mass(model: Model) -> Array:
    return center_of_mass(model.theta)


def _forearm(model: Model) -> Array:
    """Link to which the wrist, the last three joints, is attached; the world if there are no joints."""
    carrier: Arm | FreeBody = model.arm
    if isinstance(carrier, FreeBody):
        return np.zeros((), model.theta.dtype)
    return np.asarray(max(carrier.linear.shape[-2] - 3, 0), model.theta.dtype)


EFFECTS = (
    Effect(
        "cable",
        "environment",
        (
            Parameter("stiffness", "N/m", "tension per stretch", (), 0.0, 1e6, 0.0, 10.0),
            Parameter(
                "rest_length",
                "m",
                "length without tension",
                **within((), 0.0, 10.0, 0.1, 0.1, search=True, coordinate=Coordinate(zero=0.0)),
            ),
            Parameter(
                "anchor",
                "m",
                "far end of the cable in the base frame with all joints at 0; it moves with its link",
                **within((3,), -10.0, 10.0, 0.0, 0.3, search=True, coordinate=Coordinate(scale=0.1)),
            ),
            Parameter(
                "link",
                "1",
                "link that carries the anchor: 0 = the world, j = the link after joint j; default: the forearm",
                **within((), 0, 64, _forearm, 0.0, search=True, optional=True),
            ),
            Parameter(
                "attachment",
                "m",
                "near end of the cable, sensor frame; default: the tool's centre of mass",
                **within((3,), -10.0, 10.0, _center_of_mass, 0.0, search=True, optional=True, coordinate=_LINKED),
            ),
        ),
        "a cable or hose pulls at the tool",
        "give the cable slack, or route it so that it does not pull",
        reading=cable,
        needs_motion="joints",
        fit=Fitting(Pull(cable_span), any_shape=True),
        twins=(
            Twin("gravity_tilt", False, "move the arm through its workspace: a cable's pull depends on the place"),
            Twin("tool_com", False, "move the arm with the wrist held still"),
        ),
        statement=amount("something elastic pulls at the tool with {value} N per metre of stretch", "stiffness"),
    ),
    Effect(
        "contact",
        "environment",
        (
            Parameter("start", "s", "first touch of each event", (-1,), 0.0, 1e7, 0.0, 2.0, search=True),
            Parameter("end", "s", "last touch of each event", (-1,), 0.0, 1e7, 0.0, 3.0, search=True),
            Parameter("force", "N", "peak force on the tool, base frame", (-1, 3), -1e5, 1e5, 0.0, 5.0),
            Parameter(
                "point",
                "m",
                "point of the tool that is touched, sensor frame; default: the centre of mass",
                **within((-1, 3), -10.0, 10.0, _center_of_mass, 0.05, search=True, optional=True),
            ),
        ),
        "something touched the tool for a while",
        "leave these intervals out, or keep people and objects away while recording",
        reading=contact,
        fit=Fitting(Touches("start", "end", "force"), credit=0.8, any_shape=True),
        check=lambda values: "" if (values["end"] > values["start"]).all() else "an event ends before it starts",
        twins=(Twin("bias_jump", False, "a contact that does not end looks like a jump: record longer"),),
        statement=events("something pushed the tool {times} with up to {value}, from {first} on", "force", "start"),
    ),
)
