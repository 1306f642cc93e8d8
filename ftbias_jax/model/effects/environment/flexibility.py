"""A tool that is not rigid."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from ftbias_jax.model.effects.fitting import INVERSE, LOGARITHM, Coordinate, Fitting, Ringing
from ftbias_jax.model.effects.responses import rung
from ftbias_jax.model.effects.statements import amount
from ftbias_jax.model.effects.terms.memory import swing_forgets
from ftbias_jax.model.effects.types import Effect, EffectValues, Model, Parameter, Signals, Twin
from ftbias_jax.model.wrench.inertia import about_center_of_mass, spatial_inertia
from ftbias_jax.types import Array


def tool_flexibility(values: EffectValues, signals: Signals, wrench: Array) -> Array:
    """Part of the tool hangs on springs and swings against the sensor: it rings, and sags under its weight.

    There is a mode of motion for each of the three shifts and turns along and about the sensor's axes. Let w (6,) be
    the wrench of the rigid tool, M (6, 6) its spatial inertia about the sensor's origin, s_k the share of the tool that
    moves in mode k, x_k how far. Spring and damper of a mode, which the sensor reads, carry the moving part:
    -s_k M_kk (W^2 x_k + 2 zeta W x_k') = s_k (w_k + M_kk x_k''), so what they carry is the second-order response of w_k
    (``rung``), M_kk x_k'' = rung(w_k) - w_k whatever the share, and the accelerations of all modes together change the
    reading by M s x''. That one mode shakes another is left out.

    Sagging moves the place c at which the force F acts: w has the torque (x_shift + x_turn x c) x F too. It is small,
    and three rounds of substitution settle it; in it, the damper's share of x is left out.
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


def _turns_about_xy(model: Model) -> Array:
    return np.array([0, 0, 0, 1, 1, 0], model.theta.dtype)


_SOFTEST = 3.5
"""Hz; springs so soft give way by 2 cm under the tool's weight. What swings more slowly hangs, or is a liquid."""
_RIGID = 1e3
"""Hz; a tool that rings so fast is rigid, and unlike at infinite frequency derivatives are finite."""
_LEAST_DAMPED, _MOST_DAMPED = 1e-3, 0.25
"""Shares of critical damping: what swings less than a fourth of it allows is no tool on springs."""
_FREQUENCIES = tuple(np.geomspace(3.6, 30.0, 12).tolist())
"""Hz, that a search begins at."""

FLEXIBILITY = (
    Effect(
        "tool_flexibility",
        "environment",
        (
            Parameter(
                "frequency",
                "Hz",
                "of the tool on its springs, undamped",
                (),
                1.0,
                float("inf"),
                float("inf"),
                10.0,
                search=True,
                starts=_FREQUENCIES,
                coordinate=Coordinate(INVERSE, lower=_SOFTEST, upper=_RIGID),
            ),
            Parameter(
                "damping_ratio",
                "1",
                "share of critical damping",
                (),
                0.0,
                0.99,
                0.05,
                0.0,
                search=True,
                coordinate=Coordinate(LOGARITHM, scale=1.0, lower=_LEAST_DAMPED, upper=_MOST_DAMPED),
            ),
            Parameter(
                "share",
                "1",
                "of the tool that moves: shifts along, turns about the sensor's axes; default: all of it about x and y",
                (6,),
                0.0,
                2.0,
                _turns_about_xy,
                0.0,
                search=True,
                optional=True,
                # Of a rigid tool nothing moves, whatever the shares: a fit need not begin at the neutral ones.
                coordinate=Coordinate(scale=1.0, zero=0.0),
            ),
            Parameter(
                "sagging",
                "1",
                "1 if the tool's weight bends the springs, 0 if it is balanced",
                (),
                0.0,
                1.0,
                1.0,
                0.0,
                search=True,
                optional=True,
                coordinate=Coordinate(scale=1.0, zero=0.0),
            ),
        ),
        "the tool or its mounting swings at one frequency after accelerations",
        "tighten or stiffen the tool, or move more smoothly",
        reading=tool_flexibility,
        forgets=lambda values: swing_forgets(values["frequency"], values["damping_ratio"]),
        needs_motion="acceleration",
        fit=Fitting(Ringing(), any_shape=True),
        twins=(
            Twin("tool_inertia", False, "accelerate the wrist at several frequencies"),
            Twin("time_delay", False, "accelerate sharply: a flexible tool rings"),
        ),
        statement=amount("the tool rings at {value} Hz", "frequency"),
    ),
)
"""Acts on the tool's own wrench, before anything else touches the tool."""
