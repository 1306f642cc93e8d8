"""Forces and torques of the surroundings: constant, or dependent on the tool's position or orientation."""

from __future__ import annotations

from typing import Any

import numpy as np

from validation.generator.arms import Floats
from validation.generator.effects.effect import Draw, Scene
from validation.generator.kinds.kind import (
    Hooks,
    Kind,
    Parameters,
    directed,
    direction,
    near_com,
    pushed,
    times,
    twisted,
)
from validation.generator.world import ToolPath, tool_path


def wind_drawn(form: str, draw: Draw, scene: Scene) -> Parameters:
    """Draw a steady wind: a force (N) at a point and, in one form, a torque (Nm)."""
    drawn = {"force": directed(1.0), "point": near_com(0.08)} | (
        {"couple": directed(0.1)} if form == "with_couple" else {}
    )
    return {name: sample(form, draw, scene) for name, sample in drawn.items()}


def wind(form: str, p: Any, scene: Scene) -> Hooks:
    """Force that is constant in the base frame and, in one form, such a torque."""

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        return np.broadcast_to(p.force, path.position.shape), path.points(p.point)

    def couple(path: ToolPath) -> Floats:
        return np.broadcast_to(p.couple, path.position.shape)

    return pushed(load, *([couple] if form == "with_couple" else []))


def balancer_drawn(form: str, draw: Draw, scene: Scene) -> Parameters:
    """Draw a tool balancer: a rope under constant tension to a hook."""
    middle = tool_path(scene.world, scene.motion, scene.grid[::500]).position.mean(0)
    up = -scene.belief.gravity / np.linalg.norm(scene.belief.gravity)
    slanted = up + draw.rng.uniform(-0.6, 0.6, 3)
    slanted /= np.linalg.norm(slanted)
    return {
        "tension": 1.5 * draw.scale,
        "direction": slanted,
        "hook": middle + float(draw.rng.uniform(2.5, 4.0)) * slanted,
        "point": near_com(0.08)(form, draw, scene),
    }


def balancer(form: str, p: Any, scene: Scene) -> Hooks:
    """Tension of the rope, in a constant direction (the hook is on a trolley) or towards a hook fixed in space."""

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        at = path.points(p.point)
        rope = np.broadcast_to(p.direction, at.shape) if form == "trolley" else p.hook - at
        return p.tension * rope / np.linalg.norm(rope, axis=1, keepdims=True), at

    return pushed(load)


def magnet_drawn(form: str, draw: Draw, scene: Scene) -> Parameters:
    """Draw a magnet beside the path of a point of the tool."""
    point = near_com()(form, draw, scene)
    core = float(draw.rng.uniform(0.08, 0.2))
    passed = tool_path(scene.world, scene.motion, np.array([draw.rng.uniform(0.2, 0.8) * scene.duration]))
    source = passed.points(point)[0] + draw.rng.uniform(0.05, 0.15) * draw.direction()
    return {"strength": draw.scale, "core": core, "source": source, "point": point}


def magnet(form: str, p: Any, scene: Scene) -> Hooks:
    """Attraction to a point, softened within a core: to the end of a long bar magnet, or of a short one."""
    power = 3 if form == "inverse_square" else 5

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        at = path.points(p.point)
        away = p.source - at
        distance = np.sqrt((away**2).sum(1, keepdims=True) + p.core**2)
        return 2 * p.strength * away / p.core * (p.core / distance) ** power, at

    return pushed(load)


def rail(form: str, p: Any, scene: Scene) -> Hooks:
    """Attraction to a straight line: inverse to the distance, or bell-shaped with a short reach."""

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        at = path.points(p.point)
        away = p.source - at
        away = away - (away @ p.along)[:, None] * p.along
        squared = (away**2).sum(1, keepdims=True) / p.core**2
        profile = 2 / (1 + squared) if form == "inverse" else np.exp(0.5 - 0.5 * squared)
        return p.strength * away / p.core * profile, at

    return pushed(load)


def sag(form: str, p: Any, scene: Scene) -> Hooks:
    """Centre of mass that moves with gravity by ``shift`` (m at 1 g): elastically, or loosely from stop to stop."""
    gravity = scene.belief.gravity
    weight = scene.belief.tool.mass * gravity

    def couple(path: ToolPath) -> Floats:
        down = path.rotation.transpose(0, 2, 1) @ gravity / np.linalg.norm(gravity)
        moved = p.shift * (down if form == "elastic" else np.tanh(5 * down))
        return np.cross(np.einsum("tij,tj->ti", path.rotation, moved), weight)

    return twisted(couple)


def compass(form: str, p: Any, scene: Scene) -> Hooks:
    """Torque that aligns an axis of the tool with a uniform field; soft iron aligns with either end."""

    def couple(path: ToolPath) -> Floats:
        pole = path.rotation @ p.axis
        magnetised = 2 * pole @ p.field if form == "soft_iron" else np.ones(len(pole))
        return p.torque * magnetised[:, None] * np.cross(pole, p.field)

    return twisted(couple)


FIELDS = (
    Kind(
        *("wind", "constant", "base", "wrench", ("at_a_point", "with_couple"), wind_drawn, wind),
        known=lambda form, p: {"N": p.force},
        equivalent=("orientation",),
        twins=("cable",),
    ),
    Kind(
        *("balancer", "constant", "base", "force", ("trolley", "fixed_hook"), balancer_drawn, balancer),
        known=lambda form, p: {"N": p.tension * p.direction} if form == "trolley" else {},
        unseen=True,
        equivalent=("orientation", "position"),
        twins=("cable",),
    ),
    Kind(
        *("magnet_bar", "position", "base", "force", ("inverse_square", "inverse_fourth"), magnet_drawn, magnet),
        twins=("cable",),
    ),
    Kind(
        *("rail", "position", "base", "force", ("inverse", "bell")),
        lambda form, draw, scene: magnet_drawn(form, draw, scene) | {"along": draw.direction()},
        rail,
        unseen=True,
    ),
    Kind(
        *("sag", "orientation", "sensor", "torque", ("elastic", "loose")),
        {"shift": lambda form, draw, scene: 0.004 * draw.scale * np.array([*draw.rng.uniform(0.4, 1.0, 2), 0.0])},
        sag,
        unseen=True,
        equivalent=("load",),
    ),
    Kind(
        *("compass", "orientation", "base", "torque", ("permanent", "soft_iron")),
        {"torque": times(0.05), "axis": direction, "field": direction},
        compass,
        equivalent_forms={"permanent": ("constant",)},  # the field exerts two constant forces, one on each pole
    ),
)
