"""Forces and torques of the surroundings: steady ones, fields over the place of the tool, over its orientation."""

from __future__ import annotations

import numpy as np

from validation.generator.arms import Floats
from validation.generator.effects.effect import Draw, Effect, Scene
from validation.generator.kinds.kind import Parameters, loaded, near, twisted, vector
from validation.generator.world import ToolPath, tool_path


def draw_wind(form: str, draw: Draw, scene: Scene) -> Parameters:
    """A steady wind."""
    force = draw.scale * draw.direction()
    parameters = {"force": vector(force), "point": vector(near(scene.belief.tool.com, draw, 0.08))}
    if form == "with_couple":
        parameters["couple"] = vector(0.1 * draw.scale * draw.direction())
    return parameters


def build_wind(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """Forms: "at_a_point" (a force fixed in base axes), "with_couple" (also a torque fixed in base axes)."""
    force, point = np.array(parameters["force"]), np.array(parameters["point"])
    turn = np.array(parameters.get("couple", [0.0, 0.0, 0.0]))

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        return np.broadcast_to(force, path.position.shape), path.points(point)

    def couple(path: ToolPath) -> Floats:
        return np.broadcast_to(turn, path.position.shape)

    return loaded("wind", form, parameters, load, *([couple] if form == "with_couple" else []))


def draw_balancer(form: str, draw: Draw, scene: Scene) -> Parameters:
    """A tool balancer: a rope under constant tension to a hook."""
    middle = tool_path(scene.world, scene.motion, scene.grid[::500]).position.mean(0)
    up = -scene.belief.gravity / np.linalg.norm(scene.belief.gravity)
    slanted = up + draw.rng.uniform(-0.6, 0.6, 3)
    slanted /= np.linalg.norm(slanted)
    return {
        "tension": 1.5 * draw.scale,
        "direction": vector(slanted),
        "hook": vector(middle + float(draw.rng.uniform(2.5, 4.0)) * slanted),
        "point": vector(near(scene.belief.tool.com, draw, 0.08)),
    }


def build_balancer(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """Forms: "trolley" (the hook follows: the direction is fixed), "fixed_hook" (it turns a little with the place)."""
    direction, hook, point = (np.array(parameters[name]) for name in ("direction", "hook", "point"))

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        at = path.points(point)
        rope = np.broadcast_to(direction, at.shape) if form == "trolley" else hook - at
        return parameters["tension"] * rope / np.linalg.norm(rope, axis=1, keepdims=True), at

    return loaded("balancer", form, parameters, load)


def _passed(point: Floats, draw: Draw, scene: Scene, low: float, high: float) -> Floats:
    """(3,) m, a place at this distance from one where the point of the tool comes by."""
    path = tool_path(scene.world, scene.motion, np.array([draw.rng.uniform(0.2, 0.8) * scene.duration]))
    return path.points(point)[0] + draw.rng.uniform(low, high) * draw.direction()


def draw_magnet(form: str, draw: Draw, scene: Scene) -> Parameters:
    """A magnet beside the way of the tool."""
    point = near(scene.belief.tool.com, draw)
    return {
        "strength": draw.scale,
        "core": float(draw.rng.uniform(0.08, 0.2)),
        "source": vector(_passed(point, draw, scene, 0.05, 0.15)),
        "point": vector(point),
    }


def build_magnet(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """Attraction to a place, softened in a core. Forms: "inverse_square" (a long bar's end), "inverse_fourth"."""
    point, source, core = np.array(parameters["point"]), np.array(parameters["source"]), parameters["core"]
    power = 3 if form == "inverse_square" else 5

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        at = path.points(point)
        away = source - at
        distance = np.sqrt((away**2).sum(1, keepdims=True) + core**2)
        return 2 * parameters["strength"] * away / core * (core / distance) ** power, at

    return loaded("magnet_bar", form, parameters, load)


def draw_rail(form: str, draw: Draw, scene: Scene) -> Parameters:
    """A straight magnetic rail beside the way of the tool."""
    return draw_magnet(form, draw, scene) | {"along": vector(draw.direction())}


def build_rail(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """Attraction to a straight line. Forms: "inverse" (with the distance), "bell" (within a short reach)."""
    point, source, along = (np.array(parameters[name]) for name in ("point", "source", "along"))
    core = parameters["core"]

    def load(path: ToolPath) -> tuple[Floats, Floats]:
        at = path.points(point)
        away = source - at
        away = away - (away @ along)[:, None] * along
        squared = (away**2).sum(1, keepdims=True) / core**2
        profile = 2 / (1 + squared) if form == "inverse" else np.exp(0.5 - 0.5 * squared)
        return parameters["strength"] * away / core * profile, at

    return loaded("rail", form, parameters, load)


def draw_sag(form: str, draw: Draw, scene: Scene) -> Parameters:
    """The tool gives way under its own weight."""
    return {"shift": vector(0.004 * draw.scale * np.array([*draw.rng.uniform(0.4, 1.0, 2), 0.0]))}


def build_sag(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """The centre of mass moves along the weight, m at one g. Forms: "elastic", "loose" (from stop to stop)."""
    shift, gravity = np.array(parameters["shift"]), scene.belief.gravity
    weight = scene.belief.tool.mass * gravity

    def couple(path: ToolPath) -> Floats:
        down = path.rotation.transpose(0, 2, 1) @ gravity / np.linalg.norm(gravity)
        moved = shift * (down if form == "elastic" else np.tanh(5 * down))
        return np.cross(np.einsum("tij,tj->ti", path.rotation, moved), weight)

    return twisted("sag", form, parameters, couple)


def draw_compass(form: str, draw: Draw, scene: Scene) -> Parameters:
    """A magnetic field that is the same everywhere, and a tool that feels it."""
    return {"torque": 0.05 * draw.scale, "axis": vector(draw.direction()), "field": vector(draw.direction())}


def build_compass(form: str, parameters: Parameters, scene: Scene) -> Effect:
    """Torque that turns an axis of the tool to the field. Forms: "permanent" magnet, "soft_iron" (either end)."""
    axis, field = np.array(parameters["axis"]), np.array(parameters["field"])

    def couple(path: ToolPath) -> Floats:
        pole = path.rotation @ axis
        magnetised = 2 * pole @ field if form == "soft_iron" else np.ones(len(pole))
        return parameters["torque"] * magnetised[:, None] * np.cross(pole, field)

    return twisted("compass", form, parameters, couple)


def wind_coefficients(form: str, parameters: Parameters) -> dict[str, list[float]]:
    """The force, base axes."""
    return {"N": parameters["force"]}


def balancer_coefficients(form: str, parameters: Parameters) -> dict[str, list[float]]:
    """The force, base axes, if its direction is fixed."""
    fixed = form == "trolley"
    return {"N": vector(parameters["tension"] * np.array(parameters["direction"]))} if fixed else {}
