"""The series of each form over a log, for NumPy and JAX alike: what a drive does before directions are given to it.

Every function takes numpy or jax.numpy, the state at the term's point, the form's parameters and the joint. It returns
scalars (T, S), vectors (T, V, 3) in base axes or, for channels that act on themselves, (T, 6).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ftbias_jax.model.effects.terms.memory import low_passed, swing
from ftbias_jax.model.effects.terms.types import State
from ftbias_jax.types import Array

Numbers = dict[str, Array]
Make = Callable[[Any, State, Numbers, int], Array]
"""(numpy or jax.numpy, state at the term's point, parameters, joint) -> the series."""


def stack(xp: Any, *series: Array) -> Array:
    """(T,) series -> (T, S)."""
    return xp.stack(series, 1)


def _length(xp: Any, vectors: Array) -> Array:
    return xp.sqrt((vectors**2).sum(-1, keepdims=True) + 1e-12)


def spring(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Minus the place of the point, and the three axes of the base."""
    axes = xp.broadcast_to(xp.eye(3, dtype=s.position.dtype), (*s.position.shape, 3))
    return xp.concatenate([-s.position[:, None], axes], 1)


def attraction(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Towards a place, falling with a power of the distance beyond a core; 1 at half a metre."""
    away = xp.stack([p["x"], p["y"], p["z"]])[None] - s.position
    distance = xp.sqrt((away**2).sum(1, keepdims=True) + p["core"] ** 2 + 1e-6)
    return (away / distance * (0.5 / distance) ** p["power"])[:, None]


def barrier(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """A force that sets in beyond a plane and grows with the distance, softly over a length."""
    normal = xp.stack([p["x"], p["y"], p["z"]])
    beyond = (s.position @ normal) / xp.sqrt(normal @ normal + 1e-12) - p["offset"]
    return xp.logaddexp(0.0, beyond / p["length"])[:, None] * p["length"]


def place(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Place of the sensor's origin, or of the point."""
    return s.position


def place_squared(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Place, squares and products."""
    x, y, z = s.position.T
    return stack(xp, x, y, z, x * x, y * y, z * z, x * y, x * z, y * z)


def _seen(xp: Any, s: State, direction: Array) -> Array:
    """(T, 3) a direction of the base as the sensor sees it."""
    return xp.einsum("tij,i->tj", s.rotation, direction) / xp.sqrt(direction @ direction + 1e-12)


def gravity(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Direction of gravity, as the sensor sees it."""
    return _seen(xp, s, s.gravity)


def gravity_map(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Smooth and one-sided functions of the direction of gravity."""
    return _map(xp, _seen(xp, s, s.gravity))


def field_map(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """The same of another direction of the room."""
    return _map(xp, _seen(xp, s, xp.stack([p["x"], p["y"], p["z"]])))


def _map(xp: Any, direction: Array) -> Array:
    x, y, z = direction.T
    second = (x * x - y * y, 3 * z * z - 1, x * y, x * z, y * z)
    return stack(xp, x, y, z, *second, xp.abs(x), xp.abs(y), xp.abs(z))


def along(field: str, power: int) -> Make:
    """Against a vector of the state, with a power of its length."""

    def make(xp: Any, s: State, p: Numbers, joint: int) -> Array:
        vectors: Array = getattr(s, field)
        return (-vectors * _length(xp, vectors) ** (power - 1))[:, None]

    return make


def dry(field: str) -> Make:
    """Against the direction of a vector of the state, softly below a speed."""

    def make(xp: Any, s: State, p: Numbers, joint: int) -> Array:
        vectors: Array = getattr(s, field)
        return (-vectors / xp.sqrt((vectors**2).sum(-1, keepdims=True) + p["speed"] ** 2))[:, None]

    return make


def gyroscopic(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """omega x h of a momentum fixed in the tool, for each axis of the sensor: what the rotor does to the tool."""
    return -xp.cross(s.angular_velocity[:, None], xp.swapaxes(s.rotation, 1, 2))


def _specific(s: State) -> Array:
    return s.acceleration - s.gravity[None]


def swinging(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """What a unit mass on spring and damper makes of the acceleration, beyond a rigid one."""
    return -swing(xp, s.t, _specific(s), p["frequency"], p["damping_ratio"])[:, None]


def trailing(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """The part of the acceleration that a lag takes away."""
    return (s.acceleration - low_passed(xp, s.t, s.acceleration, p["lag"]))[:, None]


def angle(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Angle of a joint."""
    return s.q[:, joint - 1 : joint]


def angle_squared(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Its first three powers."""
    q = s.q[:, joint - 1]
    return stack(xp, q, q**2, q**3)


def harmonic(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Sine and cosine of a multiple of a joint's angle."""
    angle = p["multiple"] * s.q[:, joint - 1]
    return stack(xp, xp.sin(angle), xp.cos(angle))


def _speeds(s: State, joint: int) -> Array:
    return s.dq[:, joint - 1 : joint] if joint else s.dq


def viscous(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Against a joint's speed."""
    return -_speeds(s, joint)


def friction(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Against the direction of a joint's motion, softly below a speed."""
    return -xp.tanh(_speeds(s, joint) / p["speed"])


def squared_speed(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Against a joint's motion, with the square of its speed."""
    speed = _speeds(s, joint)
    return -speed * xp.abs(speed)


def heat(xp: Any, s: State, p: Numbers, joint: int) -> Array:
    """Squared speed, of one joint or of all, that is lost again with a time constant."""
    power = (_speeds(s, joint) ** 2).sum(1, keepdims=True)
    power = xp.concatenate([xp.zeros_like(power[:1]), power[1:]])
    return p["time_constant"] * low_passed(xp, s.t, power, p["time_constant"])
