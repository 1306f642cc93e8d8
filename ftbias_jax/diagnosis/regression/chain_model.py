"""All effects that change the mean reading as one differentiable model in unbounded coordinates.

One compiled function serves every effect and every combination: the chain of the catalogue is evaluated with all its
effects in place, most of them neutral, and derivatives are taken along the few directions that a fit asks for. The
motion of the arm, which only the joints' offsets change, is worked out apart, so that it is compiled once.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.diagnosis.regression.coordinates import Block, own_blocks, own_effects, own_values
from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.catalogue import CATALOGUE, neutral_values
from ftbias_jax.model.effects.kinematics import motion_of, subtract_offsets
from ftbias_jax.model.effects.table import Catalogue
from ftbias_jax.model.effects.types import Signals, Values
from ftbias_jax.model.kinematics.arm_batch import ArmMotion
from ftbias_jax.types import Array

SHORTEST_LAG = 1e-4
"""s; a low-pass with this time constant does nothing."""

SHORTEST_PERIOD = 1e-3
"""s; a tool that rings so fast is rigid, and unlike at infinite frequency derivatives are finite."""

LONGEST_PERIOD = 1 / 3.5
"""s; springs so soft give way by 2 cm under the tool's weight. What swings more slowly hangs, or is a liquid."""

MOST_LOG_DAMPING = 1.6
"""A fourth of critical damping: what swings less is no tool on springs."""


MOVING = ("encoder_offset",)
"""Effects that change how the arm moves; all else is worked out from the motion."""


def blocks(n: int, catalogue: Catalogue = CATALOGUE) -> tuple[Block, ...]:
    """Coordinates of all chained effects for an arm with n joints; those of the caller's own effects come last."""
    lever = np.array([1.0] * 3 + [0.1] * 3)
    return (
        Block("tool_mass", "mass", 1, 0.05),
        Block("tool_com", "center_of_mass", 3, 0.005),
        Block("tool_inertia", "inertia", 6, 1e-3),
        Block("gravity_tilt", "gravity", 3, 0.1),
        Block("encoder_offset", "offset", n, 0.01),
        Block("mount_rotation", "rotation", 3, 0.01),
        Block("mount_rotation", "tool_turns", 1, 1.0),
        Block("gain", "gain", 6, 0.02, -0.99 / 0.02, 99 / 0.02),
        Block("crosstalk", "matrix", 30, (0.02 * lever[:, None] / lever)[~np.eye(6, dtype=bool)]),
        Block("time_delay", "delay", 1, 0.01),
        Block("low_pass", "lag", 1, 0.02),
        Block("hysteresis", "width", 6, 0.2 * lever),
        Block("tool_flexibility", "period", 1, 0.1, 0.0, LONGEST_PERIOD / 0.1),
        Block("tool_flexibility", "log_damping", 1, 1.0, -4.0, MOST_LOG_DAMPING),
        Block("tool_flexibility", "share", 6, 1.0, 0.0, 2.0),
        Block("tool_flexibility", "sagging", 1, 1.0, 0.0, 1.0),
        Block("cable", "stiffness", 1, 10.0, 0.0, 1e6 / 10.0),
        Block("cable", "rest_length", 1, 0.1, 0.0, 10 / 0.1),
        Block("cable", "anchor", 3, 0.1, -10 / 0.1, 10 / 0.1),
        Block("cable", "attachment", 3, 0.03),
        *own_blocks(catalogue),
    )


def slices(n: int, catalogue: Catalogue = CATALOGUE) -> dict[tuple[str, str], slice]:
    """Where each parameter's coordinates are."""
    laid_out = blocks(n, catalogue)
    ends = np.cumsum([block.size for block in laid_out])
    return {(b.effect, b.parameter): slice(e - b.size, e) for b, e in zip(laid_out, ends, strict=True)}


def coordinates(n: int, effect: str) -> np.ndarray:
    """Indices of all coordinates of a built-in effect."""
    places = slices(n)
    return np.concatenate([np.arange(s.start, s.stop) for (name, _), s in places.items() if name == effect])


def bounds(n: int, catalogue: Catalogue = CATALOGUE) -> tuple[np.ndarray, np.ndarray]:
    """(P,), (P,) least and most value of every coordinate."""
    least, most = ([np.broadcast_to(edge(b), b.size) for b in blocks(n, catalogue)] for edge in (_least, _most))
    return np.concatenate(least), np.concatenate(most)


def _least(block: Block) -> float | np.ndarray:
    return block.least


def _most(block: Block) -> float | np.ndarray:
    return block.most


def size(n: int, catalogue: Catalogue = CATALOGUE) -> int:
    """Length of the whole vector."""
    return sum(block.size for block in blocks(n, catalogue))


@partial(jax.jit, static_argnames="catalogue")
def to_values(
    signals: Signals, z: Array, link: Array, catalogue: Catalogue = CATALOGUE
) -> tuple[dict[str, dict[str, Array]], Array]:
    """Catalogue values of all chained effects, and encoder offsets (n,) rad.

    Args:
        signals: of the log.
        z: (P,) coordinates.
        link: () which link carries the anchor of a cable, 0 = world.
        catalogue: that has the effects.
    """
    n, model = signals.q.shape[1], signals.model
    places, units = slices(n, catalogue), {(b.effect, b.parameter): jnp.asarray(b.unit) for b in blocks(n)}

    def move(effect: str, parameter: str) -> Array:
        value = z[places[effect, parameter]] * units[effect, parameter]
        return value

    neutral = {name: neutral_values(CATALOGUE[name], model) for name in dict.fromkeys(b.effect for b in blocks(n))}
    matrix = jnp.eye(6, dtype=z.dtype).at[np.nonzero(~np.eye(6, dtype=bool))].set(move("crosstalk", "matrix"))
    lag = jnp.maximum(move("low_pass", "lag")[0], SHORTEST_LAG)
    period = move("tool_flexibility", "period")[0]
    gravity = model.gravity + move("gravity_tilt", "gravity")
    values = {
        "tool_mass": {"mass": neutral["tool_mass"]["mass"] + move("tool_mass", "mass")[0]},
        "tool_com": {"center_of_mass": neutral["tool_com"]["center_of_mass"] + move("tool_com", "center_of_mass")},
        "tool_inertia": {"inertia": neutral["tool_inertia"]["inertia"] + move("tool_inertia", "inertia")},
        "gravity_tilt": {"gravity": gravity * jnp.linalg.norm(model.gravity) / jnp.linalg.norm(gravity)},
        "mount_rotation": {
            "rotation": move("mount_rotation", "rotation"),
            "tool_turns": move("mount_rotation", "tool_turns")[0],
        },
        "gain": {"gain": 1 + move("gain", "gain")},
        "crosstalk": {"matrix": matrix},
        "time_delay": {"delay": move("time_delay", "delay")[0]},
        "low_pass": {"cutoff": 1 / (2 * jnp.pi * lag)},
        "hysteresis": {"width": jnp.maximum(move("hysteresis", "width"), 0)},
        "tool_flexibility": {
            "frequency": 1 / jnp.maximum(period, SHORTEST_PERIOD),
            "damping_ratio": 0.05 * jnp.exp(move("tool_flexibility", "log_damping")[0]),
            # Of a rigid tool nothing moves, whatever the shares: here they need not be neutral at 0.
            "share": move("tool_flexibility", "share"),
            "sagging": move("tool_flexibility", "sagging")[0],
        },
        "cable": neutral["cable"]
        | {
            "stiffness": move("cable", "stiffness")[0],
            "rest_length": move("cable", "rest_length")[0],
            "anchor": move("cable", "anchor"),
            "attachment": neutral["cable"]["attachment"] + move("cable", "attachment"),
            "link": link,
        },
    }
    for effect in own_effects(catalogue):
        own = {parameter.name: z[places[effect.name, parameter.name]] for parameter in effect.parameters}
        values[effect.name] = own_values(effect, model, own)
    return values, move("encoder_offset", "offset")


@jax.jit
def motion(signals: Signals, known: Values, z: Array) -> ArmMotion:
    """How the arm moves with the joint offsets of coordinates z (P,), and with those that the setup knows of."""
    moved = subtract_offsets(to_values(signals, z, jnp.zeros_like(z[0]))[1], signals)
    return motion_of(compose.transform(moved, {name: known[name] for name in known if name in MOVING}))


@jax.jit
def motion_slopes(signals: Signals, known: Values, z: Array) -> tuple[ArmMotion, ...]:
    """The derivatives of ``motion`` by the coordinate of every joint's offset."""
    places = coordinates(signals.q.shape[1], "encoder_offset")
    directions = jnp.eye(len(z), dtype=z.dtype)[places]
    slopes = jax.vmap(lambda d: jax.jvp(lambda z: motion(signals, known, z), (z,), (d,))[1])(directions)
    return tuple(jax.tree.map(lambda x, i=i: x[i], slopes) for i in range(len(places)))


@partial(jax.jit, static_argnames="catalogue")
def readings(
    signals: Signals,
    known: Values,
    moving: tuple[ArmMotion, ...],
    z: Array,
    link: Array,
    catalogue: Catalogue = CATALOGUE,
) -> Array:
    """(C, B, 6) N, Nm: noise-free readings at several coordinates at once.

    Args:
        signals: of the log.
        known: effects that the setup knows of.
        moving: C times ``motion`` at z.
        z: (C, P) coordinates.
        link: (C,) which link carries the anchor of a cable.
        catalogue: that has the effects.
    """
    return jax.vmap(partial(_reading, signals, known, catalogue))(_stack(moving), z, link)


@partial(jax.jit, static_argnames="catalogue")
def slopes(
    signals: Signals,
    known: Values,
    moving: ArmMotion,
    z: Array,
    link: Array,
    directions: Array,
    changes: tuple[ArmMotion, ...],
    catalogue: Catalogue = CATALOGUE,
) -> Array:
    """(D, B, 6) N, Nm: derivatives of the reading.

    Args:
        signals: as above.
        known: as above.
        moving: ``motion`` at z.
        z: (P,) coordinates.
        link: ().
        directions: (D, P).
        changes: of the motion along each direction; zeros if it moves no joint.
        catalogue: that has the effects.
    """

    def along(direction: Array, change: ArmMotion) -> Array:
        reading = partial(_reading, signals, known, catalogue)
        slope: Array = jax.jvp(lambda moving, z: reading(moving, z, link), (moving, z), (change, direction))[1]
        return slope

    return jax.vmap(along)(directions, _stack(changes))


def _reading(signals: Signals, known: Values, catalogue: Catalogue, moving: ArmMotion, z: Array, link: Array) -> Array:
    chained, offsets = to_values(signals, z, link, catalogue)
    values = chained | {name: known[name] for name in known if name not in MOVING}
    if catalogue.own:  # these may move the joints, or look at where they are
        signals = subtract_offsets(offsets, signals)
    return compose.predict(signals._replace(motion=moving), values, catalogue)


def _stack(moving: tuple[ArmMotion, ...]) -> ArmMotion:
    stacked: ArmMotion = jax.tree.map(lambda *x: jnp.stack(x), *moving)
    return stacked
