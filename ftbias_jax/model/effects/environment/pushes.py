"""Forces on the tool besides gravity: cables and contacts."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.model.effects.fitting import Coordinate, Fitting, Pull, Touches
from ftbias_jax.model.effects.kinematics import motion_of
from ftbias_jax.model.effects.statements import amount, events
from ftbias_jax.model.effects.types import Effect, EffectValues, Model, Parameter, Signals, Twin
from ftbias_jax.model.kinematics.recorded_pose import FreeBody
from ftbias_jax.model.kinematics.screws import Arm
from ftbias_jax.model.wrench.inertia import center_of_mass
from ftbias_jax.types import Array


def cable(values: EffectValues, signals: Signals, wrench: Array) -> Array:
    """An elastic cable between the tool and a point of a link or of the world; it pulls and never pushes."""
    span = cable_span(values, signals)
    length = jnp.sqrt(jnp.maximum((span**2).sum(1), np.finfo(span.dtype).tiny))
    tension = values["stiffness"] * jnp.maximum(length - values["rest_length"], 0)
    force = (tension / length)[:, None] * span
    return wrench - jnp.concatenate([force, jnp.cross(values["attachment"][None], force)], 1)


def cable_span(values: EffectValues, signals: Signals) -> Array:
    """(T, 3) m, sensor frame: from a cable's near end to its far end."""
    motion = motion_of(signals)
    link = jnp.clip(jnp.round(values["link"]), 0, signals.q.shape[1]).astype(int)
    anchor = jnp.einsum("ijt,j->it", motion.link_rotation[:, :, link], values["anchor"]) + motion.link_position[:, link]
    tool = jnp.einsum("ijt,j->it", motion.sensor_rotation, values["attachment"]) + motion.sensor_position
    return jnp.einsum("jit,jt->ti", motion.sensor_rotation, anchor - tool)


def contact(values: EffectValues, signals: Signals, wrench: Array) -> Array:
    """Something touches the tool for a while: half sines of force, fixed in the base frame, at points of the tool."""
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


def _check_contact(values: EffectValues) -> str:
    return "" if (values["end"] > values["start"]).all() else "an event ends before it starts"


def _center_of_mass(model: Model) -> Array:
    return center_of_mass(model.theta)


def _forearm(model: Model) -> Array:
    """The link that the wrist, the last three joints, is attached to; the world if there are no joints."""
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
                (),
                0.0,
                10.0,
                0.1,
                0.1,
                search=True,
                coordinate=Coordinate(zero=0.0),
            ),
            Parameter(
                "anchor",
                "m",
                "far end of the cable in the base frame with all joints at 0; it moves with its link",
                (3,),
                -10.0,
                10.0,
                0.0,
                0.3,
                search=True,
                coordinate=Coordinate(scale=0.1),
            ),
            Parameter(
                "link",
                "1",
                "link that carries the anchor: 0 = the world, j = the link after joint j; default: the forearm",
                (),
                0,
                64,
                _forearm,
                0.0,
                search=True,
                optional=True,
            ),
            Parameter(
                "attachment",
                "m",
                "near end of the cable, sensor frame; default: the tool's centre of mass",
                (3,),
                -10.0,
                10.0,
                _center_of_mass,
                0.0,
                search=True,
                optional=True,
                coordinate=Coordinate(scale=0.03),
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
                (-1, 3),
                -10.0,
                10.0,
                _center_of_mass,
                0.05,
                search=True,
                optional=True,
            ),
        ),
        "something touched the tool for a while",
        "leave these intervals out, or keep people and objects away while recording",
        reading=contact,
        fit=Fitting(Touches("start", "end", "force"), credit=0.8, any_shape=True),
        check=_check_contact,
        twins=(Twin("bias_jump", False, "a contact that does not end looks like a jump: record longer"),),
        statement=events("something pushed the tool {times} with up to {value}, from {first} on", "force", "start"),
    ),
)
