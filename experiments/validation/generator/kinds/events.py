"""Intermittent and local effects: switched forces, gripped parts, and drag or contact in one region."""

from __future__ import annotations

from typing import Any

import numpy as np

from validation.generator.arms import Floats
from validation.generator.effects.effect import Draw, Scene
from validation.generator.kinds.kind import Hooks, Kind, between, direction, near_com, pushed, times, twisted
from validation.generator.world import ToolPath, tool_path


def spells(form: str, draw: Draw, scene: Scene) -> Floats:
    """Draw switching times (2 N,) s, on and off in turn: about ten times per 45 s, on for 0.5 to 4 s each time."""
    count = max(int(draw.rng.integers(7, 12) * scene.duration / 45), 2)
    lengths = draw.rng.uniform(0.5, min(4.0, 0.6 * scene.duration / count), count)
    gaps = draw.rng.dirichlet(np.full(count + 1, 3.0)) * (scene.duration - lengths.sum())
    starts = np.cumsum(gaps[:-1]) + np.concatenate([[0.0], np.cumsum(lengths[:-1])])
    return np.stack([starts, starts + lengths], 1).ravel()


def grips(form: str, draw: Draw, scene: Scene) -> Floats:
    """Draw times (N,) s of gripping and putting down in turn: gripped once for good, or picked and placed."""
    if form == "once":
        return draw.rng.uniform(0.25, 0.75, 1) * scene.duration
    count = 2 * int(draw.rng.integers(1, 4))
    share = draw.rng.dirichlet(np.full(count + 1, 4.0))
    picked: Floats = np.cumsum(share[:-1]) * scene.duration
    return picked


def on(t: Floats, at: Floats, within: float = 1e-9) -> Floats:
    """State (T,): 1 after an odd number of the switching times ``at``, else 0, with linear ramps of ``within`` s."""
    passed = np.clip((t[:, None] - at) / within + 0.5, 0, 1)
    switched: Floats = passed @ (-1.0) ** np.arange(len(at))
    return switched


def switched(form: str, p: Any, scene: Scene) -> Hooks:
    """Air jet or small motor on the tool, switched on and off: a force at a point or a torque, fixed in the tool."""

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        return p.force * on(path.t, p.at)[:, None] * (path.rotation @ p.axis), path.points(p.point)

    def couple(path: ToolPath) -> Floats:
        return 0.05 * p.force * on(path.t, p.at)[:, None] * (path.rotation @ p.axis)

    return pushed(load) if form == "force" else twisted(couple)


def gripped(form: str, p: Any, scene: Scene) -> Hooks:
    """Part in the hand, a point mass in kg, whose weight is taken from and returned to the table within ``lift`` s."""

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        held = p.mass * on(path.t, p.at, p.lift)
        return held[:, None] * (scene.belief.gravity - path.acceleration(p.point)), path.points(p.point)

    return pushed(load)


def thicket_drawn(form: str, draw: Draw, scene: Scene) -> dict[str, Any]:
    """Draw a region that a point of the tool passes through: its middle and its reach, m."""
    point = near_com()(form, draw, scene)
    path = tool_path(scene.world, scene.motion, scene.grid[::50]).points(point)
    middle = path[int(draw.rng.integers(len(path)))]
    reach = float(np.quantile(np.linalg.norm(path - middle, axis=1), 0.25))
    return {"drag": 3.0 * draw.scale, "middle": middle, "reach": reach, "point": point}


def thicket(form: str, p: Any, scene: Scene) -> Hooks:
    """Resistance in one region of space with a soft edge: viscous drag or dry friction."""

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        at, v = path.points(p.point), path.velocity(p.point)
        inside = np.exp(-((np.linalg.norm(at - p.middle, axis=1, keepdims=True) / p.reach) ** 4))
        size = 1.0 if form == "viscous" else 0.3 / np.hypot(np.linalg.norm(v, axis=1, keepdims=True), 0.01)
        return -p.drag * inside * size * v, at

    return pushed(load)


def bench_drawn(form: str, draw: Draw, scene: Scene) -> dict[str, Any]:
    """Draw a plane that a point of the tool is beyond for a fifth to a third of the time, and its material."""
    point = near_com()(form, draw, scene)
    path = tool_path(scene.world, scene.motion, scene.grid[::50]).points(point)
    normal = draw.direction()
    offset = float(np.quantile(path @ normal, draw.rng.uniform(0.65, 0.8)))
    friction = float(draw.rng.uniform(0.1, 0.5))
    return {"stiffness": 30.0 * draw.scale, "friction": friction, "normal": normal, "offset": offset, "point": point}


def bench(form: str, p: Any, scene: Scene) -> Hooks:
    """Soft surface that the tool presses and slides on: a linear or stiffening spring, and friction against sliding."""

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        at, v = path.points(p.point), path.velocity(p.point)
        depth = np.maximum(at @ p.normal - p.offset, 0.0)[:, None]
        pressed = p.stiffness * (depth if form == "spring" else 3 * depth**1.5)
        along = v - (v @ p.normal)[:, None] * p.normal
        slip = along / np.hypot(np.linalg.norm(along, axis=1, keepdims=True), 0.01)
        return -pressed * (p.normal + p.friction * slip), at

    return pushed(load)


EVENTS = (
    Kind(
        *("switched", "time", "sensor", "wrench", ("force", "torque")),
        {"force": times(1.0), "axis": direction, "point": near_com(0.08), "at": spells},
        switched,
    ),
    Kind(
        *("gripped", "acceleration", "base", "force", ("once", "pick_and_place")),
        {"mass": times(0.1), "point": near_com(0.08), "at": grips, "lift": between(0.01, 0.15)},
        gripped,
        known=lambda form, p: {"kg": p.mass},
    ),
    Kind(
        *("thicket", "velocity", "base", "force", ("viscous", "dry")),
        thicket_drawn,
        thicket,
        brisk=True,
    ),
    Kind(
        *("bench", "position", "base", "force", ("spring", "stiffening")),
        bench_drawn,
        bench,
        twins=("contact",),
    ),
)
