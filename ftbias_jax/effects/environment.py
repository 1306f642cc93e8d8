"""Effects of the environment stage: forces on the tool besides gravity, and a tool that is not rigid.

A force F that the environment exerts on the tool lowers the reading by F: the sensor has less to hold.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.effects.recursions import rung
from ftbias_jax.effects.tool import data_sheet
from ftbias_jax.effects.types import Effect, EffectValues, Model, Parameter, Signals, Twin
from ftbias_jax.screws import product_of_exponentials, sensor_pose
from ftbias_jax.types import Array
from ftbias_jax.wrench import tool_wrench


def cable(values: EffectValues, signals: Signals, wrench: Array) -> Array:
    """An elastic cable between the tool and a point of a link or of the world; it pulls and never pushes."""
    arm = signals.model.arm
    attachment = values["attachment"]

    def pull(q: Array) -> Array:
        rotations, positions = product_of_exponentials(arm, q)
        link = jnp.clip(jnp.round(values["link"]).astype(int), 0, q.shape[0])
        anchor = rotations[link] @ values["anchor"] + positions[link]
        R_base_sensor = rotations[-1] @ arm.zero_rotation
        tool = rotations[-1] @ arm.zero_position + positions[-1] + R_base_sensor @ attachment
        span = R_base_sensor.T @ (anchor - tool)
        length = jnp.sqrt(jnp.maximum(span @ span, np.finfo(span.dtype).tiny))
        tension = values["stiffness"] * jnp.maximum(length - values["rest_length"], 0)
        force = tension / length * span
        return jnp.concatenate([force, jnp.cross(attachment, force)])

    return wrench - jax.vmap(pull)(signals.q)


def contact(values: EffectValues, signals: Signals, wrench: Array) -> Array:
    """Something touches the tool for a while: half sines of force, fixed in the base frame, at points of the tool."""
    start, end = values["start"], values["end"]
    lasting = jnp.where(end > start, end - start, 1)
    phase = (signals.t[:, None] - start[None]) / lasting[None]
    touching = (phase > 0) & (phase < 1) & (end > start)[None]
    size = jnp.where(touching, jnp.sin(jnp.pi * jnp.clip(phase, 0, 1)), 0)

    def push(q: Array, size: Array) -> Array:
        R_base_sensor, _ = sensor_pose(signals.model.arm, q)
        force = size[:, None] * values["force"] @ R_base_sensor
        torque = jnp.cross(values["point"], force)
        return jnp.concatenate([force.sum(0), torque.sum(0)])

    return wrench - jax.vmap(push)(signals.q, size)


def tool_flexibility(values: EffectValues, signals: Signals, wrench: Array) -> Array:
    """The tool hangs on a spring: its inertial wrench arrives through a second-order response and rings.

    Gravity changes slowly against any such frequency and passes as it is.
    """
    inertial = wrench - static_wrench(signals)
    return wrench - inertial + rung(signals.t, inertial, values["frequency"], values["damping_ratio"])


def static_wrench(signals: Signals) -> Array:
    """(T, 6) N, Nm: what the tool would weigh in every pose at rest."""
    rest = jnp.zeros_like(signals.q)
    return jax.vmap(tool_wrench, (None, None, None, 0, 0, 0))(*signals.model, signals.q, rest, rest)


def _check_contact(values: EffectValues) -> str:
    return "" if (values["end"] > values["start"]).all() else "an event ends before it starts"


def _center_of_mass(model: Model) -> Array:
    return data_sheet(model.theta)[1]


def _forearm(model: Model) -> Array:
    """The link that the wrist, the last three joints, is attached to."""
    return jnp.asarray(max(model.arm.linear.shape[-2] - 3, 0), model.theta.dtype)


FLEXIBILITY = (
    Effect(
        "tool_flexibility",
        "environment",
        (
            Parameter("frequency", "Hz", "undamped", (), 0.1, float("inf"), float("inf"), 10.0, search=True),
            Parameter("damping_ratio", "1", "share of critical damping", (), 0.0, 0.99, 0.05, 0.0, search=True),
        ),
        "the tool or its mounting swings at one frequency after accelerations",
        "tighten or stiffen the tool, or move more smoothly",
        reading=tool_flexibility,
        twins=(
            Twin("tool_inertia", False, "accelerate the wrist at several frequencies"),
            Twin("time_delay", False, "accelerate sharply: a flexible tool rings"),
        ),
    ),
)
"""Acts on the tool's own wrench, before anything else touches the tool."""

EFFECTS = (
    Effect(
        "cable",
        "environment",
        (
            Parameter("stiffness", "N/m", "tension per stretch", (), 0.0, 1e6, 0.0, 10.0),
            Parameter("rest_length", "m", "length without tension", (), 0.0, 10.0, 0.1, 0.1, search=True),
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
            ),
        ),
        "a cable or hose pulls at the tool",
        "give the cable slack, or route it so that it does not pull",
        reading=cable,
        twins=(
            Twin("gravity_tilt", False, "move the arm through its workspace: a cable's pull depends on the place"),
            Twin("tool_com", False, "move the arm with the wrist held still"),
        ),
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
        check=_check_contact,
        twins=(Twin("bias_jump", False, "a contact that does not end looks like a jump: record longer"),),
    ),
)
