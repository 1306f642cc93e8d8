"""External loads on the tool: contacts (in the catalogue); drag, eddy currents, a magnet and sloshing (not in it)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from validation.generator.arms import Floats
from validation.generator.effects.effect import Draw, Effect, Scene
from validation.generator.effects.sprung import Sprung
from validation.generator.world import Load, ToolPath, World, tool_path


@dataclass(frozen=True)
class Touch:
    """One contact with the surroundings."""

    start: float
    """s."""
    duration: float
    """s."""
    force: Floats
    """(3,) N, peak force on the tool, in the base frame, or in the tool frame if it rotates with the tool."""
    point: Floats
    """(3,) m, point of application in the tool frame."""
    shape: str
    turns: bool

    def profile(self, t: Floats) -> Floats:
        """Share (T,) of the peak force at the times t (T,) s."""
        x = (t - self.start) / self.duration
        inside = (x > 0) & (x < 1)
        shapes = {
            "half_sine": np.sin(np.pi * x),
            "trapezoid": np.clip(np.minimum(x, 1 - x) / 0.2, 0, 1),
            "decay": np.clip(x / 0.03, 0, 1) * np.exp(-4 * x),
            "press": np.sin(np.pi * x) ** 2 * (1 + 0.25 * np.sin(7 * np.pi * x)),
        }
        return np.where(inside, shapes[self.shape], 0.0)

    def load(self, path: ToolPath) -> tuple[Floats, Floats]:
        """Return the force on the tool and its point of application, as a ``world.Load``."""
        force = self.profile(path.t)[:, None] * self.force
        return (np.einsum("tij,tj->ti", path.rotation, force) if self.turns else force), path.points(self.point)


def contact(form: str, draw: Draw, scene: Scene) -> Effect:
    """Two to five events of the form's shape: "half_sine", "trapezoid", "decay" (an impact), "press" (slow, uneven)."""
    rng = draw.rng
    count = int(rng.integers(2, 6))
    slots = scene.duration * (0.06 + 0.88 * (np.arange(count) + rng.uniform(0.0, 0.5, count)) / count)
    longest = 0.45 * 0.88 * scene.duration / count
    seconds = np.minimum(rng.uniform(*{"press": (1.5, 4.0), "decay": (0.3, 1.0)}.get(form, (0.3, 1.5)), count), longest)
    peak = draw.size((0.6, 1.5), (2.0, 6.0), (8.0, 20.0))
    turns = bool(rng.uniform() < 0.5)
    reach = scene.belief.tool.com
    touches = [
        Touch(float(start), float(last), peak * rng.uniform(0.6, 1) * draw.direction(), _near(reach, draw), form, turns)
        for start, last in zip(slots, seconds, strict=True)
    ]
    events = [[x.start, x.duration, x.force.tolist(), x.point.tolist(), form] for x in touches]
    parameters = {"events": events, "frame": "tool" if turns else "base"}
    return Effect("contact", form, parameters, world=lambda world: _with(world, *(x.load for x in touches)))


def _near(point: Floats, draw: Draw) -> Floats:
    return point + draw.rng.uniform(-0.05, 0.05, 3)


def _with(world: World, *loads: Load) -> World:
    return replace(world, loads=world.loads + loads)


def drag(form: str, draw: Draw, scene: Scene) -> Effect:
    """Force against the tool's velocity, proportional to its square (air, water) or to it (eddy currents). Unlisted."""
    coefficient, point = draw.size((0.3, 0.6), (1.0, 2.0), (3.0, 6.0)), _near(scene.belief.tool.com, draw)

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        v = path.velocity(point)
        speed = np.linalg.norm(v, axis=1, keepdims=True) if form == "square" else 1.0
        return -coefficient * speed * v, path.points(point)

    name = "drag" if form == "square" else "eddy"
    return Effect(name, form, {"coefficient": coefficient}, world=lambda world: _with(world, load))


def magnet(form: str, draw: Draw, scene: Scene) -> Effect:
    """Attraction towards a point near the tool's path, within a few decimetres. Unlisted."""
    point, strength = _near(scene.belief.tool.com, draw), draw.size((0.3, 0.6), (1.0, 2.0), (3.0, 6.0))
    passed = tool_path(scene.world, scene.motion, np.array([draw.rng.uniform(0.2, 0.8) * scene.duration]))
    source = passed.points(point)[0] + draw.rng.uniform(0.03, 0.08) * draw.direction()
    reach = float(draw.rng.uniform(0.08, 0.15))

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        away = source - path.points(point)
        near = np.exp(0.5 - 0.5 * (away**2).sum(1, keepdims=True) / reach**2)  # with away / reach, at most 1
        return strength * away / reach * near, path.points(point)

    parameters = {"peak": strength, "reach": reach, "source": source.tolist()}
    return Effect("magnet", form, parameters, world=lambda world: _with(world, load))


def slosh(form: str, draw: Draw, scene: Scene) -> Effect:
    """Pendulum that hangs in the tool, as in a half-filled bottle. Unlisted."""
    share = min(draw.size((0.1, 0.15), (0.2, 0.3), (0.35, 0.5)), 0.7)
    part = Sprung("pendulum", share, float(draw.rng.uniform(1.3, 2.2)), float(draw.rng.uniform(0.01, 0.05)))
    parameters = {"fraction": share, "hz": part.hz, "zeta": part.zeta}
    return Effect("slosh", form, parameters, world=lambda world: replace(world, sprung=part))
